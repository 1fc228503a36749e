# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor watched in a terminal: from a port, through the detector, onto the screen."""

import argparse
import math
import os
import shutil
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from typing import Any, NamedTuple, TextIO

import numpy as np

from retrolidar_ros.cli.arguments import add_detector_options, add_port, detector_values, seconds
from retrolidar_ros.cli.watch_view import LastReading, Snapshot, fitted, line, screen
from retrolidar_ros.detector import METHODS, Detection, Detector
from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.blinking_zones import BLINKING_DB, modulation_db, newest_bits
from retrolidar_ros.detector.frame_monitor import FrameMonitor
from retrolidar_ros.detector.parameters import DetectorSettings
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.clock import ClockMap
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.serial_source import PROTOCOLS, SerialSource, in_background
from retrolidar_ros.sensor.wire import WireCounts
from retrolidar_ros.settings.interrupts import interrupted_once

HELP = 'show zones, bits and markers of a sensor live'
DESCRIPTION = (
    'Updates a terminal five times a second; without a terminal, prints a line per second. Ctrl-C '
    'ends it. Exit code 1 if a duration ends without any frame.'
)
_SCREEN_S, _LINE_S = 0.2, 1.0  # between two pictures, or two lines of a log
_KEPT_BITS = PACKET_BITS + 3  # a packet whose end may be anywhere
_RATE_S = 2.0  # over which frames are counted for their rate
_SILENCE_S = 1.0
_MORE_DB = 3.0  # another zone has to blink by so much more than that which is shown


class _Tally(NamedTuple):
    time_s: float
    frames: int
    restarts: int
    received: WireCounts


class Watch:
    """The state of a sensor, from its frames."""

    def __init__(self, source: SerialSource, zone: int | None, values: Mapping[str, Any]) -> None:
        """Begin without frames; `zone` is the one to look at, None for that which blinks most."""
        self._source = source
        self._fixed_zone = zone
        self._settings = DetectorSettings(values)
        self._bit_s = values['bit_period']
        self._clock = ClockMap()
        if (method := values['method']) != METHODS[0]:
            raise ValueError(f'--method {method}: watch shows {METHODS[0]} only')
        self._detector: Detector | None = None
        self._monitor = FrameMonitor(ZoneGrid())
        self._read: dict[int, tuple[Detection, int]] = {}  # the last of each ID, and how many
        self._last_arrival_s = time.monotonic()
        self._tallies = deque([_Tally(self._last_arrival_s, 0, 0, source.received)])

    def take(self, frames: list[Frame], arrival_ns: int) -> None:
        """Take frames that arrived together; ValueError if the sensor has no such zone."""
        self._last_arrival_s = arrival_ns * 1e-9
        for unmapped in frames:
            stamp_ns = self._clock.map(unmapped.sensor_time_us, arrival_ns)
            frame, newest = replace(unmapped, stamp_ns=stamp_ns), self._monitor.newest
            if self._detector is None or not newest or newest[-1].grid != frame.grid:
                self._detector = self._begin(frame.grid)
            elif newest[-1].stamp_ns >= stamp_ns:
                self._monitor.restart(frame.grid)
            self._monitor.take(frame)
            detections = self._detector.update(frame)
            self._monitor.read(detections)
            for detection in self._agreement.confirmed(detections):
                _, times = self._read.get(detection.id, (None, 0))
                self._read[detection.id] = detection, times + 1

    def _begin(self, grid: ZoneGrid) -> Detector:
        if self._fixed_zone is not None and not 0 <= self._fixed_zone < grid.zones:
            raise ValueError(
                f'--zone {self._fixed_zone}: the sensor has {grid.rows}x{grid.columns} zones, '
                f'0 to {grid.zones - 1}'
            )
        self._shown_zone = self._fixed_zone
        self._agreement = Agreement(self._settings.values['min_readings'])
        self._read.clear()
        self._monitor.restart(grid)
        return self._settings.detector(grid)

    def snapshot(self) -> Snapshot:
        """Return a snapshot."""
        now_ns = time.monotonic_ns()
        received = self._source.received
        now = _Tally(now_ns * 1e-9, self._monitor.frames, self._clock.restarts, received)
        self._tallies.append(now)
        while self._tallies[1].time_s <= now.time_s - _RATE_S:
            self._tallies.popleft()
        then = self._tallies[0]
        return Snapshot(
            port=self._source.port,
            trouble=self._trouble(then, now),
            rate_hz=(now.frames - then.frames) / max(now.time_s - then.time_s, 1e-3),
            frames=now.frames,
            lost=self._monitor.lost,
            damaged=received.unread,
            **self._zones(now_ns),
        )

    def _trouble(self, then: _Tally, now: _Tally) -> str:
        if problem := self._source.problem:
            return f'{problem}; retrying'
        silence_s = now.time_s - self._last_arrival_s
        if silence_s > _SILENCE_S:
            return f'{now.received.silence(then.received)} ({silence_s:.0f} s)'
        if now.restarts - then.restarts > 1:
            return "the sensor's clock jumps again and again; are its times in microseconds?"
        hint = self._monitor.rate(self._bit_s) or self._monitor.unread(self._settings)
        return str(hint or '')

    def _zones(self, now_ns: int) -> dict[str, Any]:
        """Return zones, bits and readings, as fields of a snapshot."""
        if self._detector is None:
            return {}
        newest = self._monitor.newest[-1]
        since_ns = newest.stamp_ns - round(_KEPT_BITS * self._bit_s * 1e9)
        recent = [frame for frame in self._monitor.newest if frame.stamp_ns > since_ns]
        if len(recent) < 2:
            return {}
        recording = Recording.of(recent)
        law = self._settings.noise.lit(np.median(newest.ambient))
        blinking = modulation_db(recording, law)
        zone = self._shown_zone
        if self._fixed_zone is None:
            strongest = int(blinking.argmax())
            if blinking[strongest] < BLINKING_DB:
                zone = None
            elif zone is None or blinking[strongest] > blinking[zone] + _MORE_DB:
                zone = strongest
        self._shown_zone = zone
        readings = [
            LastReading(detection, (now_ns - detection.end_ns) * 1e-9, times)
            for detection, times in self._read.values()
        ]
        return {
            'frame': newest,
            'modulation_db': blinking,
            'zone': zone,
            'bits': None if zone is None else newest_bits(recording, zone, self._bit_s),
            'readings': readings,
            'rejected': self._detector.counts.rejected,
        }


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_port(command)
    command.add_argument(
        '--zone',
        type=int,
        metavar='N',
        help='zone whose bits to show (default: the one that blinks most)',
    )
    command.add_argument('--duration', type=seconds, metavar='S', help='end after this time [s]')
    add_detector_options(command)


def run(arguments: argparse.Namespace) -> int:
    """Show what a sensor sees until the duration is over, or Ctrl-C."""
    with suppress(KeyboardInterrupt), interrupted_once():
        reader = PROTOCOLS[arguments.protocol](time.monotonic_ns)
        source = SerialSource(arguments.port, arguments.baud, reader, time.monotonic_ns)
        state = Watch(source, arguments.zone, detector_values(arguments))
        interval_s = _SCREEN_S if is_screen(sys.stdout) else _LINE_S
        begin_s = time.monotonic()
        end_s = begin_s + (arguments.duration or math.inf)
        due_s = min(begin_s + interval_s, end_s)
        with in_background(source) as take_until, _display(sys.stdout) as show:
            while True:
                if (arrival := take_until(due_s)) is not None:
                    state.take(*arrival)
                now_s = time.monotonic()
                if now_s >= due_s:
                    show(known := state.snapshot())
                    if now_s >= end_s:
                        return 0 if known.frames else 1
                    due_s = min(now_s + interval_s, end_s)
    return 0


@contextmanager
def _display(output: TextIO) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that shows a snapshot: on a whole terminal, else as a line."""
    if not is_screen(output):
        yield lambda snapshot: print(line(snapshot), file=output, flush=True)
        return

    def draw(snapshot: Snapshot) -> None:
        columns, rows = shutil.get_terminal_size()
        lines = fitted(screen(snapshot), columns, rows)
        # Home; each line and the end of the one before; then the rest of the screen.
        output.write('\x1b[H' + '\x1b[K\r\n'.join(lines) + '\x1b[J')
        output.flush()

    output.write('\x1b[?25l\x1b[2J')  # no cursor, no text
    try:
        yield draw
    finally:
        output.write('\r\n\x1b[?25h')
        output.flush()


def is_screen(output: TextIO) -> bool:
    """Return whether an output is a terminal that can be drawn on."""
    return output.isatty() and os.environ.get('TERM', 'dumb') != 'dumb'
