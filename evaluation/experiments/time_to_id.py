# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long it takes until a repeating marker that comes into view is identified."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from evaluation.bench.judging import BOTH, Options, judged
from evaluation.bench.recordings import SILENCE_BITS, Sent, record, signal_at
from evaluation.bench.stresses import PLAIN
from evaluation.peers.background import Background
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.pictures import View, read_pictures
from evaluation.peers.visual_markers import APRILTAG, find_readers
from evaluation.report.charts import legend_below, look, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.noise import noisy
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.truth import PACKET_S

TITLE = 'Time to the first ID'
MESSAGE = 'A tag answers in a picture, a LiDAR marker in little more than a packet'
TIMEOUT_S = 12.0
VIEW_S = SILENCE_BITS * BIT_PERIOD_S  # when the markers come into view
SHARES = (0.5, 0.9)
_RANGES_M = (1.0, 1.5, 2.0, 2.4, 2.6, 2.8, 3.0, 3.2, 3.4, 3.6)
_RECORDINGS, _QUICK_RECORDINGS = 2, 1
_PICTURES, _QUICK_PICTURES = 48, 8


def appearing(range_m: float, rng: np.random.Generator) -> Sent:
    """Return markers that have always been sending and come into view at `VIEW_S`."""
    sent = record(PLAIN, signal_at(range_m), rng, USABLE_IDS, repeated_s=VIEW_S + TIMEOUT_S)
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
    ranges_m = _RANGES_M[::3] if quick else _RANGES_M
    recordings = _QUICK_RECORDINGS if quick else _RECORDINGS
    readers = [one for one in find_readers()[0] if one.name == APRILTAG]
    background = Background(rng)
    points = []
    for range_m in tqdm(ranges_m, desc='time-to-id', leave=False):
        point: dict[str, Any] = {'range_m': range_m}
        times: dict[str, list[Any]] = {method: [] for method in METHODS}
        wrong = dict.fromkeys(METHODS, 0)
        for _ in range(recordings):
            sent = appearing(range_m, rng)
            for method in METHODS:
                found, errors = first_ids(sent, BOTH[method])
                times[method].append(found)
                wrong[method] += errors
        for method in METHODS:
            all_s = np.concatenate(times[method])
            point[method] = {
                'by_share_s': [time_by_which(share, all_s) for share in SHARES],
            }
        count = _QUICK_PICTURES if quick else _PICTURES
        for name, result in read_pictures(readers, background, count, rng, View(range_m)).items():
            read = result['read']['rate']
            point[name] = {'by_share_s': [_by_pictures(share, read) for share in SHARES]}
        points.append(point)
    return {'points': points, 'names': [*METHODS, *(one.name for one in readers)]}


def _seconds(time_s: float | None) -> str:
    return f'>{TIMEOUT_S:g} s' if time_s is None else f'{time_s:.2g} s'


def table(figures: dict[str, Any]) -> Table:
    """Return the times by which half and nine tenths are identified."""
    rows = [['identified within: half, nine tenths', *figures['names']]]
    rows += [
        [
            f'{point["range_m"]:g} m',
            *(
                ', '.join(_seconds(time_s) for time_s in point[name]['by_share_s'])
                for name in figures['names']
            ),
        ]
        for point in figures['points']
    ]
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw the times over distance."""
    figure, ((axis,),) = new_chart(1, 1, 10, 6, MESSAGE)
    ranges_m = [point['range_m'] for point in figures['points']]
    for name in figures['names']:
        for index, style in enumerate(('-', '--')):
            times_s = [point[name]['by_share_s'][index] for point in figures['points']]
            places = [place for place, time_s in zip(ranges_m, times_s, strict=True) if time_s]
            axis.plot(places, [time_s for time_s in times_s if time_s], style, **look(name))
    for time_s, words in (
        (SENSOR.period_s, 'one frame of the sensor'),
        (1 / PICTURES_HZ, 'one picture'),
        (PACKET_S, 'one packet'),
    ):
        axis.axhline(time_s, color='0.5', linewidth=1, linestyle=':')
        axis.text(ranges_m[-1] + 0.18, 1.05 * time_s, words, fontsize=11, color='0.35', ha='right')
    axis.set_yscale('log')
    axis.set_ylim(0.015, 1.4 * TIMEOUT_S)
    axis.set_xlim(ranges_m[0] - 0.2, ranges_m[-1] + 0.2)
    axis.set_xlabel('distance of a marker of 3 cm [m]')
    axis.set_ylabel('from view to the first right ID [s]')
    others = {
        'half': {'color': '0.2', 'linestyle': '-'},
        'nine tenths': {'color': '0.2', 'linestyle': '--'},
    }
    legend_below(figure, figures['names'], others)
    return figure
