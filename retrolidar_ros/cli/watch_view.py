# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The display of `retrolidar watch`: a snapshot as lines of text."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.budget import Demands
from retrolidar_ros.detector.likelihood_detector import Candidate, Reason
from retrolidar_ros.detector.newest_bits import NewestBits
from retrolidar_ros.detector.tracks import Track
from retrolidar_ros.sensor.frame import Floats, Frame

COLUMNS = 80
"""Width of lines that are made to fit: of 8x8 zones they are wider."""
ROWS = 22
"""As many lines as 4x4 zones need when nothing is wrong."""
_FULL_BAR_DB = 40.0
_CELL = {4: 18, 8: 11}  # width of a zone by the columns of the grid
_READINGS = 3  # with 4x4 zones they all fit on 22 lines


# All in code page 437, which the console of Linux has, too.
DARK, BRIGHT, ERASED = '█·?'
_SHADES = f' ░▒▓{DARK}'  # of soft bits, from bright to dark
_SYMBOLS = f'{BRIGHT}▌─│┼{_SHADES}'
_ASCII = str.maketrans(_SYMBOLS, '.--|+ .:+#')


def expressed(text: str, encoding: str) -> str:
    """Return a text with symbols that an encoding has."""
    try:
        _SYMBOLS.encode(encoding)
    except UnicodeEncodeError:
        return text.translate(_ASCII)
    return text


class LastReading(NamedTuple):
    """The last reading of a marker."""

    detection: Detection
    age_s: float
    times: int
    """How often the marker has been read so far."""
    track: Track | None = None
    """Where it is now, while it is followed."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The state of port, zones and markers at one moment."""

    port: str
    trouble: str
    """What is wrong or to be known, and what to do about it; empty if nothing is."""
    rate_hz: float
    frames: int
    lost: int
    damaged: int
    """Packets that held no frame."""
    frame: Frame | None = None
    """The newest."""
    modulation_db: Floats = field(default_factory=lambda: np.empty(0))
    """How much each zone of that frame blinks [dB], shape (zones,)."""
    zone: int | None = None
    """The zone whose bits are shown; None while none blinks and none is chosen."""
    bits: NewestBits | None = None
    """Of that zone; None while there are too few."""
    readings: Sequence[LastReading] = ()
    rejected: Mapping[str, int] = field(default_factory=dict)
    """How many candidates the detector has rejected in all zones so far, by reason."""
    last_rejected: Candidate | None = None
    """The last of them."""
    demands: Demands | None = None
    """The thresholds for a candidate."""


def screen(snapshot: Snapshot) -> list[str]:
    """Return the whole snapshot, in lines of at most 100 characters."""
    lines = [_head(snapshot), *_trouble(snapshot)]
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
        detection, age_s, _, track = min(snapshot.readings, key=lambda reading: reading.age_s)
        now = f', now at {track.place.range_m:.3f} m' if track else ''
        parts.append(
            f'last ID {detection.id} at {detection.place.range_m:.3f} m, {age_s:.1f} s ago{now}'
        )
    return '; '.join(parts)


def _head(snapshot: Snapshot) -> str:
    """Return the numbers, and as much of the port's end as has room behind them."""
    flow = f'{_flow(snapshot)} at '
    room = max(COLUMNS - len(flow), 10)
    port = snapshot.port
    return flow + (port if len(port) <= room else f'...{port[3 - room :]}')


def _flow(snapshot: Snapshot) -> str:
    return (
        f'{snapshot.rate_hz:.1f} frames/s, {snapshot.frames} frames, {snapshot.lost} lost, '
        f'{snapshot.damaged} damaged packets'
    )


def _trouble(snapshot: Snapshot) -> list[str]:
    """Return problems in lines that fit; a path that does not fit is broken."""
    if not snapshot.trouble:
        return ['']
    return textwrap.wrap(f'! {snapshot.trouble}', COLUMNS, break_on_hyphens=False)


def _zones(snapshot: Snapshot, frame: Frame) -> Iterator[str]:
    """Yield the zones in rows and columns, each in two lines."""
    grid = frame.grid
    rule = '┼'.join(['─' * _CELL[grid.columns]] * grid.columns)
    for row in range(grid.rows):
        # The rows of a larger grid would not fit on a screen with a line between them.
        if row and grid.rows == 4:
            yield rule
        zones = range(row * grid.columns, (row + 1) * grid.columns)
        cells = [_cell(snapshot, frame, zone) for zone in zones]
        yield '│'.join(top for top, _ in cells)
        yield '│'.join(bottom for _, bottom in cells)


def _cell(snapshot: Snapshot, frame: Frame, zone: int) -> tuple[str, str]:
    """Return the two lines of a zone."""
    width = _CELL[frame.grid.columns]
    bar = width - 8
    halves = round(2 * bar * min(max(float(snapshot.modulation_db[zone]), 0.0) / _FULL_BAR_DB, 1.0))
    blinking = DARK * (halves // 2) + '▌' * (halves % 2)
    mark = '>' if zone == snapshot.zone else ' '
    top = f'{mark}{zone:<2} {blinking:<{bar}} {frame.status[zone]:>3}'
    decimals = 3 if frame.grid.columns == 4 else 2
    signal, distance = _number(frame.signal[zone]), _number(frame.distance[zone], decimals)
    return top, f'{signal:>6}{distance:>{width - 6}}'


def _bits(snapshot: Snapshot) -> list[str]:
    """Return the levels and newest bits of the shown zone."""
    if snapshot.zone is None:
        return ['no zone blinks', '', '']
    bits = snapshot.bits
    if bits is None:
        return [f'zone {snapshot.zone}: too little of 31 bits, or all alike', '', '']
    steps = np.nan_to_num(np.clip(bits.darkness * len(_SHADES), 0, len(_SHADES) - 1)).astype(int)
    soft = np.where(bits.erased, ERASED, np.array(list(_SHADES))[steps])
    hard = np.where(bits.erased, ERASED, np.where(bits.hard, DARK, BRIGHT))
    return [
        f'zone {snapshot.zone}: bright {bits.bright:.1f}, dark {bits.dark:.1f} kcps/SPAD',
        f'  soft    {"".join(soft)}',
        f'  bits    {"".join(hard)}  {DARK} dark, 1   {BRIGHT} bright, 0',
    ]


def _readings(snapshot: Snapshot) -> list[str]:
    """Return the last reading of each of the latest markers; * = its range now, as followed."""
    newest = sorted(snapshot.readings, key=lambda reading: reading.age_s)[:_READINGS]
    lines = [
        *_rejected(snapshot),
        'read   ID  times  s ago  range [m]  score  SNR [dB]  corrected  packets  zones'
        + ('    * now' if any(one.track for one in newest) else ''),
    ]
    # By ID, so that they stay where they are.
    for detection, age_s, times, track in sorted(newest, key=lambda one: one.detection.id):
        place, mark = (track.place, '*') if track else (detection.place, ' ')
        lines.append(
            f'{detection.id:9d}  {times:5d}  {age_s:5.1f}  {place.range_m:9.3f}{mark} '
            f'{detection.score:5.2f}  {detection.snr_db:8.1f}  {detection.corrected_bits:9d}  '
            f'{detection.packets:7d}  {",".join(map(str, detection.zones))}'
        )
    if not newest:
        lines[-1] = 'nothing has been read yet'
    return lines


def _rejected(snapshot: Snapshot) -> list[str]:
    """Return the counts of rejected candidates, and how far the last missed its threshold."""
    reasons = [f'{reason} {count}' for reason, count in sorted(snapshot.rejected.items())]
    text = f'rejected so far: {", ".join(reasons) or "nothing"}'
    last, asked = snapshot.last_rejected, snapshot.demands
    if last is not None and last.reason is not None and asked is not None:
        shortfall = {
            Reason.EVIDENCE: f' {last.evidence:.1f} of {asked.evidence:.1f} nats',
            Reason.NOT_A_WORD: f', {last.word:.1f} nats, {asked.word:.1f} allowed',
            Reason.MARGIN: f' {last.margin:.1f} of {asked.margin:.1f} nats',
        }
        text += f'; last ID {last.id}: {last.reason.value}{shortfall.get(last.reason, "")}'
    return textwrap.wrap(text, COLUMNS, initial_indent='  ', subsequent_indent='    ')


def _number(value: float, decimals: int = 1) -> str:
    """Return a number in six characters, a dash where there is none."""
    if not math.isfinite(value):
        return '-'
    return f'{value:.{decimals}f}' if abs(value) < 1000 else f'{value:.0f}'


def _decibels(value: float) -> str:
    return f'{value:.1f} dB' if math.isfinite(value) else 'not'
