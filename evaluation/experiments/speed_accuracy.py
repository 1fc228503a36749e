# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Processor time of each method against its reach, for every setting."""

import time
from contextlib import suppress
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.judging import Options, judge_all, read_of
from evaluation.bench.rates import LEVEL, crossing, sum_of
from evaluation.bench.recordings import dark, record_at, rng_at
from evaluation.experiments import paper_sweeps
from evaluation.peers import visual_markers
from evaluation.peers.camera import Background
from evaluation.peers.visual_markers import AprilTagReader, QrReader, Reader, View
from evaluation.report.chart_style import label, look, name_curve, new_chart
from evaluation.report.claims import Table, end_as_text
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.reference import SENSOR

TITLE = 'Speed against accuracy'
_LONE_M = paper_sweeps.RANGES_M[4:]
_SEVERAL_M = (1.0, 2.0, 2.6, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0, 4.4)
_FRAMES, _WARM_UP_S, _SCENES = 400, 10.5, 20
_AT_M, _TALKING = 2.0, (0, 5, 10)  # the latter are zones


class Point(NamedTuple):
    """One setting of a knob of the LiDAR's methods."""

    options: Options
    packets: int = 1
    recordings: int = 4


def _curves() -> dict[str, dict[str, Point]]:
    """Return the settings of the LiDAR's methods by their labels, by the knob that is swept."""
    some = np.random.default_rng(0).permutation(USABLE_IDS)
    joint, paper = {'method': 'joint', 'max_packets': 1}, {'method': 'paper'}
    return {
        'joint: packets combined': {
            '1': Point(joint, 1, paper_sweeps.LONE_RECORDINGS),
            **{f'{n}': Point(joint | {'max_packets': n}, n, 3) for n in (2, 3, 5, 8)},
        },
        'joint: IDs registered': {
            f'{n}': Point(joint | {'registered_ids': some[:n]}) for n in (1000, 64, 16)
        },
        'joint: false IDs allowed an hour': {
            f'{n:g}': Point(joint | {'false_ids_per_hour': n}) for n in (1000.0, 10.0, 0.001)
        },
        'paper: threshold': {
            f'{least:g}': Point(paper | {'likelihood_threshold': least}, 3, 3)
            for least in (0.1, 0.2, 0.3, 0.38, 0.5)
        },
    }


def _frame_ms(options: Options, scenes: int, rng: np.random.Generator) -> float:
    """Return the processor time per second of watching three markers that may be read [ms]."""
    spent_s = []
    ids, lasting_s = options.get('registered_ids', USABLE_IDS), _FRAMES * SENSOR.period_s
    silent = np.isin(np.arange(SENSOR.grid.zones), _TALKING, invert=True)
    for _ in range(scenes):
        sent = record_at(_AT_M, rng, ids=np.array(ids), repeated_s=_WARM_UP_S + lasting_s)
        frames = list(dark(sent, silent, rng).recording)
        detector = create_detector(grid=SENSOR.grid, **options)
        for frame in frames[:-_FRAMES]:
            detector.update(frame)
        began_s = time.process_time()
        for frame in frames[-_FRAMES:]:
            detector.update(frame)
        spent_s.append(time.process_time() - began_s)
    return 1e3 * float(np.mean(spent_s)) / lasting_s


def _summed(text: str, cpu_ms: float, places: Any, found: Any) -> dict[str, Any]:
    right, wrong = ([one[key] for one in found] for key in ('right', 'wrong'))
    return {
        'label': text,
        'cpu_ms': cpu_ms,
        'reach_m': crossing(LEVEL, places, right),
        'half_m': crossing(0.5, places, right),
        'wrong': sum_of(wrong),
    }


def _lidar(text: str, point: Point, quick: bool, seed: int) -> dict[str, Any]:
    """Return what a setting of the LiDAR costs and gives, of the same frames as all others."""
    places = (_LONE_M if point.packets == 1 else _SEVERAL_M)[:: 3 if quick else 1]
    is_lone, known = point.packets == 1, np.array(point.options.get('registered_ids', USABLE_IDS))
    several = partial(paper_sweeps.repeating, size_m=0.03, packets=point.packets)
    make = partial(record_at, ids=known) if is_lone else several
    found = []
    for range_m in places:
        count, rng = 1 if quick else point.recordings, rng_at(seed, range_m)
        read = judge_all(partial(make, range_m), count, rng, {text: point.options}, lone=is_lone)
        found.append(read_of(read[text]))
    cpu_ms = _frame_ms(point.options, 1 if quick else _SCENES, np.random.default_rng(seed))
    return _summed(text, cpu_ms, places, found)


def _cameras(seed: int, *, quick: bool) -> dict[str, list[dict[str, Any]]]:
    """Return what the settings of readers of visual markers cost and give, of the same pictures."""
    decimations = (4.0, 3.0, 2.0, 1.5, 1.0)[:: 2 if quick else 1]
    knobs: dict[str, dict[str, Reader]] = {
        'AprilTag: decimation': {
            f'{one:g}': AprilTagReader(f'tag {one:g}', one) for one in decimations
        },
        'AprilTag: two threads': {'2': AprilTagReader('threads', threads=2)},
    }
    with suppress(ImportError):  # `peers` says what is missing
        knobs['QR code: zbar'] = {'': QrReader()}
    readers = [reader for settings in knobs.values() for reader in settings.values()]
    ranges_m = paper_sweeps.TAG_RANGES_M[:: 5 if quick else 1]
    found = visual_markers.read_over_distance(readers, ranges_m, seed, quick=quick)
    background = Background(np.random.default_rng(seed))

    def summed(text: str, reader: Reader) -> dict[str, Any]:
        rng, pictures = np.random.default_rng(seed), 1 if quick else 4
        cpu_ms = visual_markers.picture_cost(reader, background, pictures, rng, View(_AT_M))
        return _summed(text, cpu_ms, ranges_m, [one[reader.name] for one in found])

    return {name: [summed(*one) for one in of.items()] for name, of in knobs.items()}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return processor time, reach and wrong IDs of every setting of every knob."""
    seed, stride = int(rng.integers(2**31)), 4 if quick else 1
    curves = {
        name: [_lidar(*point, quick, seed) for point in list(points.items())[::stride]]
        for name, points in _curves().items()
    }
    return {'curves': curves | _cameras(seed, quick=quick)}


def cpu_ms(figures: dict[str, Any], name: str) -> float:
    """Return the processor time of the usual setting of LiDAR or tag [ms a second]."""
    curve, text = _COSTS[name]
    found = next(one for one in figures['curves'][curve] if one['label'] == text)
    return float(found['cpu_ms'])


def table(figures: dict[str, Any]) -> Table:
    """Return what every knob costs and gives, its settings one after the other."""
    heads = ['settings', 'ms of a core a second', '80 % to [m]', 'half to [m]', 'wrong IDs']

    def cells(point: dict[str, Any]) -> list[str]:
        most, half = end_as_text(point['reach_m'], ''), end_as_text(point['half_m'], '', level=0.5)
        wrong = f'{point["wrong"]["rate"]:.1%}'
        return [point['label'], f'{point["cpu_ms"]:.0f}', most, half, wrong]

    rows = [['knob', *heads]]
    for name, points in figures['curves'].items():
        columns = zip(*map(cells, points), strict=True)
        rows.append([name, *(' / '.join(column) for column in columns)])
    return rows


_CURVES = {
    'joint: packets combined': ('joint', 'reach_m', 'LiDAR: packets combined'),
    'paper: threshold': ('paper', 'half_m', "paper's method: to where HALF are read"),
    'AprilTag: decimation': ('AprilTag', 'reach_m', 'AprilTag: decimation'),
}  # whose colour, which reach, and the words of the curves that are drawn
_DEAR_MS = 100.0
_COSTS = {'LiDAR': ('joint: packets combined', '1'), 'tag': ('AprilTag: decimation', '2')}


def _message(figures: dict[str, Any]) -> str:
    times = float(f'{cpu_ms(figures, "tag") / cpu_ms(figures, "LiDAR"):.0e}')
    tags = f'Watching for AprilTags (decimation {_COSTS["tag"][1]}) takes about {times:.0f} times'
    return f'{tags} the processor time of LiDAR markers (lone packets)'


def draw(figures: dict[str, Any]) -> Any:
    """Draw reach over processor time."""
    figure, (axis,) = new_chart(1, 1, 4.4, _message(figures))
    for curve, (name, key, words) in _CURVES.items():
        points = [one for one in figures['curves'].get(curve, ()) if one[key]['at'] is not None]
        if not points:
            continue
        places = [one['cpu_ms'] for one in points]
        reaches, low, high = np.array(
            [[one[key][end] for one in points] for end in ('at', 'low', 'high')], dtype=float
        )
        how = look(name)
        bars = np.maximum([reaches - low, high - reaches], 0)
        half = {'markerfacecolor': 'white', 'linestyle': ':'} if key == 'half_m' else {}
        axis.plot(places, reaches, **how | half, zorder=3)
        axis.errorbar(places, reaches, bars, linestyle='', color=how['color'], capsize=3)
        # Names stand right of cheap curves, and above and left of dear ones.
        is_dear, top = places[-1] > _DEAR_MS, int(np.argmax(reaches))
        times, rise, ha = (0.8, 0.25, 'right') if is_dear else (1.25, 0.0, 'left')
        name_curve(axis, name, words, (places[top] * times, reaches[top] + rise), ha=ha)
        for end, times, rise, ha in ((0, 0.9, 0, 'right'), (-1, 1, 0.25, 'center')):
            if not half:
                beside = (times * places[end], reaches[end] + rise)
                name_curve(axis, name, points[end]['label'], beside, ha=ha)
    x, y = 'processor time per second of watching [ms]', '80 % of markers of 3 cm are read to [m]'
    label(axis, x, y, xscale='log', xticks=(1, 3, 10, 30, 100, 300, 1000), ylim=(0, 5))
    return figure
