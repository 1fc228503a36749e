# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each method costs in computing time, and what it reads for it: every knob swept."""

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.judging import Options, judged, read_of
from evaluation.bench.rates import crossing, sum_of
from evaluation.bench.recordings import rng_at
from evaluation.experiments import paper_sweeps
from evaluation.experiments.bound import genie_reach
from evaluation.peers import visual_markers
from evaluation.peers.camera import Background
from evaluation.peers.visual_markers import AprilTagReader, QrReader, Reader, View
from evaluation.report.chart_style import LEVEL, label, legend_below, line, look, new_chart
from evaluation.report.claims import Table, end_as_text
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS, choose_ids
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.scene.truth import PACKET_S

TITLE = 'Speed against accuracy'
MESSAGE = (
    "LiDAR: three metres for less than a hundredth of an AprilTag's computing; "
    'AprilTag: an answer at once'
)
_LONE_M = paper_sweeps.RANGES_M[4:]
_SEVERAL_M = (1.0, 2.0, 2.6, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0, 4.4)
_FRAMES, _WARM_UP_FRAMES, _TIMES = 400, 500, 5
_AT_M, _TALKING = 2.0, 3


class Point(NamedTuple):
    """One setting of a knob of the LiDAR's methods."""

    options: Options
    packets: int = 1
    recordings: int = 4


def _curves() -> dict[str, dict[str, Point]]:
    """Return the settings of the LiDAR's methods by their labels, by the knob that is swept."""
    joint, paper = {'method': 'joint', 'max_packets': 1}, {'method': 'paper'}
    return {
        'joint: packets combined': {
            f'{n}': Point(
                joint | {'max_packets': n}, n, 3 if n > 1 else paper_sweeps.LONE_RECORDINGS
            )
            for n in (1, 2, 3, 5, 8)
        },
        'joint: IDs registered': {
            f'{n}': Point(joint | {'registered_ids': choose_ids(n)[0]}) for n in (1000, 64, 16)
        },
        'joint: false IDs allowed an hour': {
            f'{n:g}': Point(joint | {'false_ids_per_hour': n}) for n in (1000.0, 10.0, 0.001)
        },
        'paper: threshold': {
            f'{least:g}': Point(paper | {'likelihood_threshold': least}, 3, 3)
            for least in (0.1, 0.2, 0.3, 0.38, 0.5)
        },
    }


def _frame_ms(options: Options, rng: np.random.Generator) -> float:
    """Return the processor time per second of watching three markers that may be read [ms]."""
    scene = marker_in_each_zone(_AT_M, rng, start_s=(-PACKET_S, 0.0), packets=None)
    some = scene.markers[:: len(scene.markers) // _TALKING][:_TALKING]
    ids = rng.choice(options.get('registered_ids', USABLE_IDS), _TALKING, replace=False).tolist()
    markers = tuple(replace(one, id=id_) for one, id_ in zip(some, ids, strict=True))
    simulation = Simulation(replace(scene, markers=markers), rng)
    before, timed = simulation.advance(_WARM_UP_FRAMES), simulation.advance(_FRAMES)
    spent_s = []
    for _ in range(_TIMES):
        detector = create_detector(grid=SENSOR.grid, **options)
        detector.update_all(before)
        began_s = time.process_time()
        for frame in timed:
            detector.update(frame)
        spent_s.append(time.process_time() - began_s)
    return 1e3 * min(spent_s) / (_FRAMES * SENSOR.period_s)


def _summed(text: str, cpu_ms: float, answer_s: float, places: Any, found: Any) -> dict[str, Any]:
    right, wrong = ([one[key] for one in found] for key in ('right', 'wrong'))
    return {
        'label': text,
        'cpu_ms': cpu_ms,
        'answer_s': answer_s,
        'reach_m': crossing(LEVEL, places, right),
        'half_m': crossing(0.5, places, right),
        'wrong': sum_of(wrong),
    }


def _lidar(text: str, point: Point, quick: bool, seed: int) -> dict[str, Any]:
    """Return what a setting of the LiDAR costs and gives, of the same frames as all others."""
    places = (_LONE_M if point.packets == 1 else _SEVERAL_M)[:: 3 if quick else 1]
    is_lone, known = point.packets == 1, np.array(point.options.get('registered_ids', USABLE_IDS))
    several = partial(paper_sweeps.repeating, size_m=0.03, packets=point.packets)
    found = []
    for range_m in places:
        rng, make = (
            rng_at(seed, range_m),
            partial(paper_sweeps.lone, ids=known) if is_lone else several,
        )
        sent = [make(range_m, rng) for _ in range(1 if quick else point.recordings)]
        found.append(read_of([judged(one, point.options, lone=is_lone) for one in sent]))
    cpu_ms = _frame_ms(point.options, np.random.default_rng(seed))
    return _summed(text, cpu_ms, point.packets * PACKET_S, places, found)


def _cameras(seed: int, *, quick: bool) -> dict[str, list[dict[str, Any]]]:
    """Return what the settings of readers of visual markers cost and give, of the same pictures."""
    knobs: dict[str, list[tuple[str, Reader]]] = {}
    try:
        knobs['AprilTag: decimation'] = [
            (f'{decimate:g}', AprilTagReader(f'tag {decimate:g}', decimate))
            for decimate in (4.0, 3.0, 2.0, 1.5, 1.0)[:: 2 if quick else 1]
        ]
        knobs['AprilTag: two threads'] = [('2', AprilTagReader('threads', 2.0, threads=2))]
        knobs['QR code: zbar'] = [('', QrReader())]
    except ImportError:
        pass  # `peers` says what is missing
    readers = [reader for settings in knobs.values() for _, reader in settings]
    ranges_m = paper_sweeps.TAG_RANGES_M[:: 3 if quick else 1]
    found = visual_markers.read_over_distance(readers, ranges_m, seed, quick=quick)
    background = Background(np.random.default_rng(seed))

    def summed(text: str, reader: Reader) -> dict[str, Any]:
        rng = np.random.default_rng(seed)
        cpu_ms = visual_markers.picture_cost(
            reader, background, 1 if quick else 4, rng, View(_AT_M)
        )
        return _summed(text, cpu_ms, 1 / 30, ranges_m, [one[reader.name] for one in found])

    return {name: [summed(*one) for one in settings] for name, settings in knobs.items()}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return processor time, reach and wrong IDs of every setting of every knob."""
    seed, stride = int(rng.integers(2**31)), 2 if quick else 1
    curves = {
        name: [_lidar(*point, quick, seed) for point in list(points.items())[::stride]]
        for name, points in _curves().items()
    }
    return {
        'curves': curves | _cameras(seed, quick=quick),
        'genie_m': genie_reach(seed, quick=quick),
        'frame_ms': 1e3 * SENSOR.period_s,
    }


def at(figures: dict[str, Any], curve: str, text: str) -> dict[str, Any] | None:
    """Return a setting of a knob, None if it was not measured."""
    return next((one for one in figures['curves'].get(curve, ()) if one['label'] == text), None)


def table(figures: dict[str, Any]) -> Table:
    """Return what every knob costs and gives, its settings one after the other."""
    heads = ['settings', 'ms of a core a second', '80 % to [m]', 'half to [m]', 'wrong IDs']

    def cells(point: dict[str, Any]) -> list[str]:
        reaches = (end_as_text(point[key], '').rstrip() for key in ('reach_m', 'half_m'))
        return [point['label'], f'{point["cpu_ms"]:.0f}', *reaches, f'{point["wrong"]["rate"]:.1%}']

    rows = [['knob', *heads]]
    for name, points in figures['curves'].items():
        columns = zip(*map(cells, points), strict=True)
        rows.append([name, *(' / '.join(column) for column in columns)])
    return rows


_LINES = {
    'joint: packets combined': ('o-', 'default: 1 to 8 packets combined'),
    'joint: IDs registered': ('s--', 'default: 1000 to 16 IDs registered'),
    'joint: false IDs allowed an hour': ('P:', 'default: 0.001 to 1000 false IDs an hour'),
    'paper: threshold': ('D--', 'paper, 3 packets: threshold 0.5 to 0.1; only HALF are read'),
    'AprilTag: decimation': ('v-', 'AprilTag 3: decimation 4 to 1'),
    'QR code: zbar': ('X-', 'QR code'),
}  # sign, line and words of the curves that are drawn


def _frontier(points: Sequence[dict[str, Any]]) -> list[tuple[float, float]]:
    """Return the points than which none is cheaper and reads farther, as steps."""
    steps: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda one: float(one['cpu_ms'])):
        reach_m = point['reach_m']['at'] or 0.0
        if not steps or reach_m > steps[-1][1]:
            if steps:
                steps.append((point['cpu_ms'], steps[-1][1]))
            steps.append((point['cpu_ms'], reach_m))
    return steps


def draw(figures: dict[str, Any]) -> Any:
    """Draw reach over processor time, wrong IDs as colour, and reach over the time to an answer."""
    figure, (cost, answer) = new_chart(2, 2, 16, 8.4, MESSAGE)
    curves = {name: points for name, points in figures['curves'].items() if name in _LINES}
    every = [point for points in curves.values() for point in points]
    most_wrong = 10 * max(math.ceil(10 * point['wrong']['rate']) for point in every) or 10  # [%]
    entries: dict[str, Any] = {}
    for name, points in curves.items():
        form, words = _LINES[name]
        sign, style = form[0], form[1:]
        how = look(name.partition(':')[0]) | {'marker': sign, 'linestyle': style}
        entries[words] = how | {'markerfacecolor': 'white'}
        # Where four of five are hardly read anywhere, half are shown.
        key = 'half_m' if name.startswith('paper') else 'reach_m'
        shown = [point for point in points if point[key]['at'] is not None]
        for axis, place in ((cost, 'cpu_ms'), (answer, 'answer_s')):
            places = [one[place] for one in shown]
            reaches, low, high = np.array(
                [[one[key][end] for one in shown] for end in ('at', 'low', 'high')], dtype=float
            )
            bars = np.maximum([reaches - low, high - reaches], 0)
            axis.plot(places, reaches, **entries[words], linewidth=1.5)
            axis.errorbar(places, reaches, bars, linestyle='', color=how['color'], capsize=3)
            wrong = [100 * point['wrong']['rate'] for point in shown]
            spots = {'s': 120, 'marker': sign, 'edgecolors': how['color'], 'linewidths': 2}
            colours = {'c': wrong, 'cmap': 'Reds', 'vmin': 0, 'vmax': most_wrong}
            image = axis.scatter(places, reaches, **spots, **colours, zorder=3)
    frontier = line('-', '0.7') | {'linewidth': 5, 'alpha': 0.5}
    cost.plot(*zip(*_frontier(every), strict=True), **frontier, zorder=0)
    genie = line('--', look('genie')['color'])
    if figures['genie_m'] is not None:
        for axis in (cost, answer):
            axis.axhline(figures['genie_m'], **genie)
    answer.axvline(1e-3 * figures['frame_ms'], **line(':', '0.3'))
    answer.axvline(PACKET_S, **line('-.', '0.3'))
    y = '80 % (of method paper: half) of markers of 3 cm are read to [m]'
    label(cost, 'processor time per second of watching [ms]', y, xscale='log', ylim=(0, 4.5))
    label(answer, 'time to an answer [s]', '', xscale='log', ylim=(0, 4.5))
    figure.colorbar(image, ax=answer, label='wrong IDs [%]', shrink=0.7)
    entries |= {
        'frontier: nothing cheaper reads farther': frontier,
        'genie-aided bound of one packet': genie,
        'one frame': line(':', '0.3'),
        'one packet': line('-.', '0.3'),
    }
    legend_below(figure, (), entries, columns=3)
    return figure
