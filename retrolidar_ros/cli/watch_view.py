# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The display of `retrolidar watch`: a snapshot as lines of text."""

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.blinking_zones import NewestBits
from retrolidar_ros.sensor.frame import Floats, Frame

COLUMNS = 80  # width of lines that are made to fit: of 8x8 zones they are wider
ROWS = 21  # as many lines as 4x4 zones need when nothing is wrong
_FULL_BAR_DB = 40.0
_CELL = {4: 18, 8: 11}  # width of a zone by the columns of the grid
_READINGS = 3  # with 4x4 zones they all fit on 21 lines
DARK, BRIGHT, ERASED = '#.?'


class LastReading(NamedTuple):
    """The last reading of a marker."""

    detection: Detection
    age_s: float
    times: int  # how often the marker has been read so far


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of port, zones and markers at one moment."""

    port: str
    trouble: str  # what is wrong or to be known, and what to do about it; empty if nothing is
    rate_hz: float
    frames: int
    lost: int
    damaged: int  # packets that held no frame
    frame: Frame | None = None  # the newest
    modulation_db: Floats = field(default_factory=lambda: np.empty(0))
    """How much each zone of that frame blinks [dB], shape (zones,)."""
    zone: int | None = None  # whose bits are shown; None while none blinks and none is chosen
    bits: NewestBits | None = None  # of that zone; None while there are too few
    readings: Sequence[LastReading] = ()
    rejected: Mapping[str, int] = field(default_factory=dict)  # candidates so far, by reason


def screen(snapshot: Snapshot) -> list[str]:
    """Return the whole snapshot, in lines of at most 100 characters."""
    trouble = f'! {snapshot.trouble}' if snapshot.trouble else ''
    flow = f'{_flow(snapshot)} at '
    # Of a long port its end is shown; a path in the text is broken.
    lines = [flow + snapshot.port[-max(COLUMNS - len(flow), 10) :]]
    lines += textwrap.wrap(trouble, COLUMNS, break_on_hyphens=False) or ['']
    if snapshot.frame is None:
        return lines
    return [
        *lines,
        'seen from the sensor: zone, blinking, status / signal [kcps/SPAD], distance [m]',
        *_zones(snapshot, snapshot.frame),
        *_bits(snapshot),
        *_readings(snapshot),
    ]


def fitted(lines: list[str], columns: int, rows: int) -> list[str]:
    """Return what fits the terminal, and if that is not all, the size needed."""
    longest = max(map(len, lines))
    shown = [text[:columns] for text in lines[:rows]]
    if longest > columns or len(lines) > rows:
        needed = f'enlarge the terminal to {max(COLUMNS, longest)}x{max(ROWS, len(lines))}'
        shown[-1] = needed[:columns]
    return shown


def line(snapshot: Snapshot) -> str:
    """Return the most important values in one line."""
    parts = [snapshot.trouble] if snapshot.trouble else []
    parts.append(_flow(snapshot))
    if (frame := snapshot.frame) is not None and snapshot.rate_hz > 0:
        if (zone := snapshot.zone) is None:
            parts.append('no zone blinks')
        else:
            parts.append(
                f'zone {zone}: {_number(frame.signal[zone])} kcps/SPAD, '
                f'{_number(frame.distance[zone], 3)} m, status {frame.status[zone]}, '
                f'blinking {_decibels(snapshot.modulation_db[zone])}'
            )
    if snapshot.readings:
        detection, age_s, _ = min(snapshot.readings, key=lambda reading: reading.age_s)
        parts.append(
            f'last ID {detection.id} at {detection.place.range_m:.3f} m, {age_s:.1f} s ago'
        )
    return '; '.join(parts)


def _flow(snapshot: Snapshot) -> str:
    return (
        f'{snapshot.rate_hz:.1f} frames/s, {snapshot.frames} frames, {snapshot.lost} lost, '
        f'{snapshot.damaged} damaged packets'
    )


def _zones(snapshot: Snapshot, frame: Frame) -> Iterator[str]:
    grid = frame.grid
    rule = '+'.join(['-' * _CELL[grid.columns]] * grid.columns)
    for row in range(grid.rows):
        # The rows of a larger grid would not fit on a screen with a line between them.
        if row and grid.rows == 4:
            yield rule
        zones = range(row * grid.columns, (row + 1) * grid.columns)
        cells = [_cell(snapshot, frame, zone) for zone in zones]
        yield '|'.join(top for top, _ in cells)
        yield '|'.join(bottom for _, bottom in cells)


def _cell(snapshot: Snapshot, frame: Frame, zone: int) -> tuple[str, str]:
    width = _CELL[frame.grid.columns]
    bar = width - 8
    blinking = '=' * round(bar * min(max(snapshot.modulation_db[zone] / _FULL_BAR_DB, 0.0), 1.0))
    mark = '>' if zone == snapshot.zone else ' '
    top = f'{mark}{zone:<2} {blinking:<{bar}} {frame.status[zone]:>3}'
    decimals = 3 if frame.grid.columns == 4 else 2
    signal, distance = _number(frame.signal[zone]), _number(frame.distance[zone], decimals)
    return top, f'{signal:>6}{distance:>{width - 6}}'


def _bits(snapshot: Snapshot) -> list[str]:
    if snapshot.zone is None:
        return ['no zone blinks', '']
    bits = snapshot.bits
    if bits is None:
        return [f'zone {snapshot.zone}: too little of 31 bits, or all alike', '']
    hard = np.where(bits.erased, ERASED, np.where(bits.hard, DARK, BRIGHT))
    return [
        f'zone {snapshot.zone}: bright {bits.bright:.1f}, dark {bits.dark:.1f} kcps/SPAD',
        f'  bits    {"".join(hard)}  {DARK} dark, 1   {BRIGHT} bright, 0',
    ]


def _readings(snapshot: Snapshot) -> list[str]:
    """Return the counts of rejected candidates, and the last reading of the latest markers."""
    reasons = [f'{reason} {count}' for reason, count in sorted(snapshot.rejected.items())]
    rejected = f'rejected so far: {", ".join(reasons) or "nothing"}'
    lines = textwrap.wrap(rejected, COLUMNS, initial_indent='  ', subsequent_indent='    ')
    newest = sorted(snapshot.readings, key=lambda reading: reading.age_s)[:_READINGS]
    if not newest:
        return [*lines, 'nothing has been read yet']
    heads = 'read   ID  times  s ago  range [m]  score  SNR [dB]  corrected  packets  zones'
    # By ID, so that they stay where they are.
    return [*lines, heads] + [
        f'{one.id:9d}  {times:5d}  {age_s:5.1f}  {one.place.range_m:9.3f}  {one.score:5.2f}  '
        f'{one.snr_db:8.1f}  {one.corrected_bits:9d}  {one.packets:7d}  '
        f'{",".join(map(str, one.zones))}'
        for one, age_s, times in sorted(newest, key=lambda one: one.detection.id)
    ]


def _number(value: float, decimals: int = 1) -> str:
    """Return a number in six characters, a dash where there is none."""
    if not math.isfinite(value):
        return '-'
    return f'{value:.{decimals}f}' if abs(value) < 1000 else f'{value:.0f}'


def _decibels(value: float) -> str:
    return f'{value:.1f} dB' if math.isfinite(value) else 'not'
