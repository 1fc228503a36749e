# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each method costs in computing time, and what it reads for it: every knob swept."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from evaluation.bench.judging import Options, new_detector, read_shares
from evaluation.bench.rates import crossing, rate
from evaluation.bench.recordings import Sent, record, signal_at
from evaluation.bench.stresses import PLAIN
from evaluation.experiments import bound
from evaluation.experiments.paper_sweeps import lone, repeating
from evaluation.experiments.speed_chart import draw
from evaluation.peers.background import Background
from evaluation.peers.pictures import View, picture_cost, read_pictures
from evaluation.peers.visual_markers import AprilTagReader, QrReader, Reader
from evaluation.report.charts import LEVEL
from evaluation.report.claims import Table, end_as_text
from retrolidar_ros.marker.dictionary import choose_ids
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.scene.truth import PACKET_S

__all__ = ['TITLE', 'at', 'draw', 'run', 'table']

TITLE = 'Speed against accuracy'
_LONE_M = (1.0, 1.6, 2.0, 2.4, 2.6, 2.7, 2.8, 2.9, 3.0, 3.2, 3.4)
_SEVERAL_M = (1.0, 2.0, 2.6, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0, 4.4)
_TAGS_M = (0.4, 0.6, 0.8, 1.0, 1.4, 1.8, 2.2, 2.6, 3.0, 3.4, 3.8, 4.2)
_RECORDINGS, _PICTURES, _TIMED_PICTURES = 3, 32, 4
_QUICK_RECORDINGS, _QUICK_PICTURES, _QUICK_TIMED_PICTURES = 1, 6, 1
_FRAMES, _WARM_UP_FRAMES = 400, 500
_AT_M, _TALKING = 2.0, 3


class Point(NamedTuple):
    """One setting of a knob."""

    label: str
    options: Options
    packets: int = 1


def _curves() -> dict[str, list[Point]]:
    """Return the settings of the LiDAR's methods, by the knob that is swept."""
    joint = {'method': 'joint', 'max_packets': 1}
    return {
        'joint: packets combined': [
            Point(f'{packets}', {'method': 'joint', 'max_packets': packets}, packets)
            for packets in (1, 2, 3, 5, 8)
        ],
        'joint: IDs registered': [
            Point(f'{count}', joint | {'registered_ids': choose_ids(count)[0]})
            for count in (1000, 64, 16)
        ],
        'joint: false IDs allowed an hour': [
            Point(f'{budget:g}', joint | {'false_ids_per_hour': budget})
            for budget in (1000.0, 10.0, 0.001)
        ],
        'paper: threshold': [
            Point(f'{threshold:g}', {'method': 'paper', 'likelihood_threshold': threshold}, 3)
            for threshold in (0.1, 0.2, 0.3, 0.38, 0.5)
        ],
    }


def _of_known(range_m: float, ids: NDArray[np.int64], rng: np.random.Generator) -> Sent:
    return record(PLAIN, signal_at(range_m), rng, ids)


def _frame_ms(options: Options, rng: np.random.Generator) -> float:
    """Return the processor time per second of watching three markers [ms]."""
    scene = marker_in_each_zone(_AT_M, rng, start_s=(-PACKET_S, 0.0), packets=None)
    some = scene.markers[:: len(scene.markers) // _TALKING][:_TALKING]
    simulation = Simulation(
        scene.__class__(sensor=SENSOR, markers=some, surfaces=scene.surfaces), rng
    )
    before, timed = simulation.advance(_WARM_UP_FRAMES), simulation.advance(_FRAMES)
    spent_s = []
    for _ in range(2):
        detector = new_detector(SENSOR.grid, options)
        detector.update_all(before)
        began_s = time.process_time()
        for frame in timed:
            detector.update(frame)
        spent_s.append(time.process_time() - began_s)
    return 1e3 * min(spent_s) / (_FRAMES * SENSOR.period_s)


def _lidar(point: Point, recordings: int, quick: bool, seed: int) -> dict[str, Any]:
    """Return what a setting of the LiDAR costs and gives."""
    places = (_LONE_M if point.packets == 1 else _SEVERAL_M)[:: 3 if quick else 1]
    make = lone if point.packets == 1 else partial(repeating, size_m=0.03, packets=point.packets)
    known = point.options.get('registered_ids')
    found = []
    for range_m in places:
        rng = np.random.default_rng([seed, round(100 * range_m)])  # the same for all settings
        make_one: Callable[[np.random.Generator], Sent] = partial(make, range_m)
        if known is not None:
            make_one = partial(_of_known, range_m, np.array(known))
        shares = read_shares(
            make_one, recordings, rng, {'it': point.options}, lone=point.packets == 1
        )
        found.append(shares['it'])
    wrong = [one['wrong'] for one in found]
    return {
        'label': point.label,
        'cpu_ms': _frame_ms(point.options, np.random.default_rng(seed)),
        'answer_s': point.packets * PACKET_S,
        'reach_m': crossing(LEVEL, places, [one['right'] for one in found]),
        'half_m': crossing(0.5, places, [one['right'] for one in found]),
        'wrong': rate(sum(one['hits'] for one in wrong), sum(one['trials'] for one in wrong)),
    }


def _camera(
    reader: Reader, label: str, background: Background, counts: tuple[int, int], seed: int
) -> dict[str, Any]:
    """Return what a setting of a reader of visual markers costs and gives."""
    rng = np.random.default_rng(seed)
    found = [
        read_pictures([reader], background, counts[0], rng, View(range_m))[reader.name]
        for range_m in _TAGS_M
    ]
    wrong = [one['wrong'] for one in found]
    return {
        'label': label,
        'cpu_ms': picture_cost(reader, background, counts[1], rng, View(_AT_M)),
        'answer_s': 1 / 30,
        'reach_m': crossing(LEVEL, _TAGS_M, [one['read'] for one in found]),
        'half_m': crossing(0.5, _TAGS_M, [one['read'] for one in found]),
        'wrong': rate(sum(one['hits'] for one in wrong), sum(one['trials'] for one in wrong)),
    }


def _readers() -> dict[str, list[tuple[str, Reader]]]:
    """Return the settings of the readers of visual markers that are installed, by their knob."""
    found: dict[str, list[tuple[str, Reader]]] = {}
    try:
        found['AprilTag: decimation'] = [
            (f'{decimate:g}', AprilTagReader(f'tag {decimate:g}', decimate))
            for decimate in (4.0, 3.0, 2.0, 1.5, 1.0)
        ]
        found['AprilTag: two threads'] = [('2', AprilTagReader('threads', 2.0, threads=2))]
        found['QR code: zbar'] = [('', QrReader())]
    except ImportError:
        pass  # `peers` says what is missing
    return found


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return processor time, reach and wrong IDs of every setting of every knob."""
    seed = int(rng.integers(2**31))
    recordings = _QUICK_RECORDINGS if quick else _RECORDINGS
    counts = (_QUICK_PICTURES, _QUICK_TIMED_PICTURES) if quick else (_PICTURES, _TIMED_PICTURES)
    curves = {
        name: [_lidar(point, recordings, quick, seed) for point in points[:: 2 if quick else 1]]
        for name, points in tqdm(_curves().items(), desc='speed-accuracy', leave=False)
    }
    background = Background(rng)
    for name, readers in tqdm(_readers().items(), desc='speed-accuracy', leave=False):
        curves[name] = [
            _camera(reader, label, background, counts, seed)
            for label, reader in readers[:: 2 if quick else 1]
        ]
    told_m = bound.told_reach(1 if quick else 4, rng)
    return {'curves': curves, 'told_m': told_m, 'frame_ms': 1e3 * SENSOR.period_s}


def at(figures: dict[str, Any], curve: str, label: str) -> dict[str, Any] | None:
    """Return a setting of a knob, None if it was not measured."""
    return next((one for one in figures['curves'].get(curve, ()) if one['label'] == label), None)


def table(figures: dict[str, Any]) -> Table:
    """Return what every knob costs and gives, its settings one after the other."""
    rows = [
        ['knob', 'settings', 'ms of a core a second', '80 % to [m]', 'half to [m]', 'wrong IDs']
    ]

    def reach(point: dict[str, Any], key: str) -> str:
        return end_as_text(point[key]).removesuffix(' m')

    for name, points in figures['curves'].items():
        cells = zip(
            *(
                (
                    point['label'],
                    f'{point["cpu_ms"]:.0f}',
                    reach(point, 'reach_m'),
                    reach(point, 'half_m'),
                    f'{point["wrong"]["rate"]:.1%}',
                )
                for point in points
            ),
            strict=True,
        )
        rows.append([name, *(' / '.join(one) for one in cells)])
    return rows
