# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long it takes until a repeating marker that comes into view is identified."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.judging import BOTH, Options, judged
from evaluation.bench.recordings import SILENCE_BITS, Sent, record, signal_at
from evaluation.bench.stresses import PLAIN
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.visual_markers import APRILTAG, find_readers, read_over_distance
from evaluation.report.chart_style import label, legend_below, line, look, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.scene.noise import noisy
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.truth import PACKET_S

TITLE = 'Time to the first ID'
MESSAGE = 'A tag answers in a picture, a LiDAR marker in little more than a packet'
TIMEOUT_S = 12.0
VIEW_S = SILENCE_BITS * BIT_PERIOD_S  # when the markers come into view
SHARES = (0.5, 0.9)
_STYLES = {'half': '-', 'nine tenths': '--'}
_RANGES_M = (1.0, 1.5, 2.0, 2.4, 2.6, 2.8, 3.0, 3.2, 3.4, 3.6)


def appearing(range_m: float, rng: np.random.Generator) -> Sent:
    """Return markers that have always been sending and come into view at `VIEW_S`."""
    sent = record(PLAIN, signal_at(range_m), rng, repeated_s=VIEW_S + TIMEOUT_S)
    before = sent.recording.stamp_ns < VIEW_S * 1e9
    wall = noisy(np.full(sent.recording.signal.shape, WALL_SIGNAL), NOISE, rng)
    signal = np.where(before[:, None], wall, sent.recording.signal).astype(np.float32)
    return sent._replace(recording=replace(sent.recording, signal=signal))


def first_ids(sent: Sent, options: Options) -> tuple[NDArray[np.float64], int]:
    """Return the time from view to the first right ID of each zone, and how many IDs were wrong.

    The times are in seconds, infinite where there was no right ID, shape (zones,).
    """
    times_s = np.full(len(sent.ids), math.inf)
    found = judged(sent, options, lone=False)
    for one in found.own:
        zone = next(zone for zone in one.zones if sent.ids[zone] == one.id)
        times_s[zone] = min(times_s[zone], one.end_ns * 1e-9 - VIEW_S)
    return times_s, found.readings - len(found.own)


def time_by_which(share: float, times_s: NDArray[np.float64]) -> float | None:
    """Return the time by which a share of all has been identified; None = never."""
    time_s = float(np.sort(times_s)[math.ceil(share * len(times_s)) - 1])
    return time_s if math.isfinite(time_s) else None


def _by_pictures(share: float, read: float) -> float | None:
    """Return the time by which a share is read, of pictures that are independent of each other."""
    if read <= 0:
        return None
    pictures = 1 if read >= share else math.ceil(math.log(1 - share) / math.log(1 - read))
    time_s = pictures / PICTURES_HZ
    return time_s if time_s <= TIMEOUT_S else None


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return times to the first right ID over distance."""
    readers = [one for one in find_readers()[0] if one.name == APRILTAG]
    ranges_m, points = _RANGES_M[:: 3 if quick else 1], []
    pictures = read_over_distance(readers, ranges_m, int(rng.integers(2**31)), quick=quick)
    for range_m, found in zip(ranges_m, pictures, strict=True):
        sent = [appearing(range_m, rng) for _ in range(1 if quick else 2)]
        point: dict[str, Any] = {'range_m': range_m}
        for method in METHODS:
            times_s = np.concatenate([first_ids(one, BOTH[method])[0] for one in sent])
            point[method] = [time_by_which(share, times_s) for share in SHARES]
        for name, result in found.items():
            point[name] = [_by_pictures(share, result['right']['rate']) for share in SHARES]
        points.append(point)
    return {'points': points, 'names': [*METHODS, *(one.name for one in readers)]}


def table(figures: dict[str, Any]) -> Table:
    """Return the times by which half and nine tenths are identified."""
    rows = [['identified within: half, nine tenths', *figures['names']]]
    for point in figures['points']:
        times = [
            [f'>{TIMEOUT_S:g} s' if one is None else f'{one:.2g} s' for one in point[name]]
            for name in figures['names']
        ]
        rows.append([f'{point["range_m"]:g} m', *map(', '.join, times)])
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw the times over distance."""
    figure, (axis,) = new_chart(1, 1, 10, 6.2, MESSAGE)
    ranges_m = [point['range_m'] for point in figures['points']]
    for name in figures['names']:
        for index, style in enumerate(_STYLES.values()):
            times_s = [point[name][index] or np.nan for point in figures['points']]
            axis.plot(ranges_m, times_s, style, **look(name))
    limits = {'one frame': SENSOR.period_s, 'one picture': 1 / PICTURES_HZ, 'one packet': PACKET_S}
    for words, time_s in limits.items():
        axis.axhline(time_s, color='0.5', linewidth=1, linestyle=':')
        axis.text(ranges_m[-1] + 0.18, 1.05 * time_s, words, fontsize=11, color='0.35', ha='right')
    x, y = 'distance of a marker of 3 cm [m]', 'from view to the first right ID [s]'
    ends = (ranges_m[0] - 0.2, ranges_m[-1] + 0.2)
    label(axis, x, y, yscale='log', ylim=(0.015, 1.4 * TIMEOUT_S), xlim=ends)
    legend_below(figure, figures['names'], {words: line(one) for words, one in _STYLES.items()})
    return figure
