# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames from the text that ST's own example prints, so that a kit needs no other firmware.

It is `53L8A1_SimpleRanging` of X-CUBE-TOF1 (NUCLEO-F401RE, `Src/app_tof.c`): a banner, the format
of a cell, and a table with two lines of cells a row: distance and status, and signal and ambient
light once the key `s` has switched these on.
"""

import re
from collections.abc import Callable

import numpy as np

from retrolidar_ros.sensor.frame import GRIDS, Frame, ZoneGrid
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.sensor.wire import Reader, Splitter

MAX_LINE_BYTES = 512  # one of eight cells has 258, if its numbers have five digits
SWITCH_LIGHT = b's'  # switches the signal and the ambient light on, or off again
PATIENCE_FRAMES = 5  # frames without signal until it is requested again: some were on the way

_LINE_END = b'\n'
_TEXT = re.compile(rb'[\x1b\r\x20-\x7e]*')
_HOME = '\x1b[2H'
_TABLE_TITLE = 'Cell Format'
_LIGHT_TITLE = 'Signal ['
# A distance is green, so a line of distances is never taken for one of signals.
_RANGING = re.compile(r' *\x1b\[38;5;10m *(-?\d{1,10})\x1b\[0m *: *(\d{1,10}) *')
_LIGHT = re.compile(r' *(\d{1,10}|X) *: *(\d{1,10}|X) *')
_NOTHING = re.compile(r' *X *: *X *')
# Undoes ST's mapping of statuses, which gives 5 and 9 the same number.
_STATUSES = {0: Status.VALID, 255: Status.NOT_UPDATED}
_MAX_DISTANCE_MM = 2**15  # the sensor's driver has it in 16 bits

_Cell = tuple[float, float]


def _ranging(cell: str) -> _Cell:
    """Return distance [m] and status of a cell; ValueError if it is none."""
    if _NOTHING.fullmatch(cell):
        return np.nan, Status.NO_TARGET
    match = _RANGING.fullmatch(cell)
    if not match:
        raise ValueError(f'{cell!r} is no distance and status')
    distance_mm, status = int(match[1]), int(match[2])
    if abs(distance_mm) > _MAX_DISTANCE_MM or status > 255:
        raise ValueError(f'distance {distance_mm} mm or status {status} is impossible')
    return distance_mm / 1000, _STATUSES.get(status, status)


def _light(cell: str) -> _Cell:
    """Return signal and ambient light [kcps/SPAD] of a cell; ValueError if it is none."""
    match = _LIGHT.fullmatch(cell)
    if not match:
        raise ValueError(f'{cell!r} is no signal and ambient light')
    signal, ambient = (0.0 if text == 'X' else float(text) for text in match.groups())
    return signal, ambient


class _Table:
    def __init__(self) -> None:
        self.has_title = False
        self._has_light = False
        self._lines: list[list[str]] = []  # cells of ranging, and of light after each, if any

    def take(self, line: str) -> bool:
        """Take a line; return whether it completes the table; ValueError if it is none of it."""
        line = line.strip()
        if not line.startswith('|'):
            self.has_title |= _TABLE_TITLE in line
            self._has_light |= _LIGHT_TITLE in line
            return False
        cells = line[1:-1].split('|')
        if not ''.join(cells).strip():  # above each row there is a line of empty cells
            return False
        self._lines.append(cells)
        columns = len(self._lines[0])
        if (columns, len(cells)) not in GRIDS or not line.endswith('|'):
            raise ValueError(f'a line of {len(cells)} cells')
        return len(self._lines) == columns * (1 + self._has_light)

    def frame(self, sequence: int, now_us: int) -> Frame | None:
        """Return the frame of a complete table, None without light; ValueError for a wrong cell."""
        side, step = len(self._lines[0]), 1 + self._has_light
        ranging = np.array([_ranging(cell) for line in self._lines[::step] for cell in line])
        if not self._has_light:
            return None
        light = np.array([_light(cell) for line in self._lines[1::step] for cell in line])
        return Frame(
            stamp_ns=now_us * 1000,
            sequence=sequence,
            sensor_time_us=now_us,
            grid=ZoneGrid(side, side),
            distance=ranging[:, 0].astype(np.float32),
            signal=light[:, 0].astype(np.float32),
            ambient=light[:, 1].astype(np.float32),
            status=ranging[:, 1].astype(np.uint8),
        )


class StExampleReader(Reader):
    """Finds frames in the text of ST's example; accepts any bytes.

    The left of the scene comes first, as in a `Frame`. There is no time and no counter: a frame
    bears the host's time at the end of its last row, and `sequence` counts the frames passed on.
    Status 9, merged, comes as 5, valid. A frame without signal and ambient light is withheld, and
    the reader requests them; where there is no target they are 0.

    There is no checksum: an inconsistent table is dropped and counted, a wrong digit is not
    noticed. Memory is bounded.
    """

    def __init__(self, now_ns: Callable[[], int]) -> None:
        """Start anywhere in the text; `now_ns` returns the host's time [ns]."""
        super().__init__(Splitter(_LINE_END, MAX_LINE_BYTES))
        self._now_ns = now_ns
        self.restart()

    def restart(self) -> None:
        """Forget a frame that was cut off, and what was requested."""
        self._pieces = Splitter(_LINE_END, MAX_LINE_BYTES)
        self._table: _Table | None = None
        self._dark_frames = 0  # frames without signal since one with it
        self._is_light_wanted = False

    def request(self) -> bytes:
        """Return the key that switches the signal on, once: a second press would undo it."""
        is_wanted, self._is_light_wanted = self._is_light_wanted, False
        return SWITCH_LIGHT if is_wanted else b''

    def _read(self, piece: bytes | None) -> Frame | None:
        if piece is None or not _TEXT.fullmatch(piece):
            self.counts.bad_framing += piece is not None
            self._table = None
            return None
        _, home, line = piece.decode('ascii').rpartition(_HOME)
        is_title = _TABLE_TITLE in line
        if home or (is_title and (self._table is None or self._table.has_title)):
            if self._table is not None:
                self.counts.bad_shape += 1
            self._table = _Table()
        if self._table is None:
            return None
        try:
            if not self._table.take(line):
                return None
            frame = self._table.frame(self.counts.frames % 2**32, self._now_ns() // 1000)
        except ValueError:
            self.counts.bad_shape += 1
            self._table = None
            return None
        self._table = None
        if frame is None:
            self._is_light_wanted |= self._dark_frames % PATIENCE_FRAMES == 0
            self._dark_frames += 1
            self.counts.withheld += 1
            return None
        self._is_light_wanted, self._dark_frames = False, 0
        return frame
