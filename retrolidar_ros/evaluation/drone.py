# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How steadily a hovering drone is read, and how well it is ranged (paper §7.2)."""

from __future__ import annotations

import itertools
from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from retrolidar_ros.detector import METHODS, Detection
from retrolidar_ros.detector.place import Place
from retrolidar_ros.evaluation.charts import look, new_chart, shared_legend
from retrolidar_ros.evaluation.detectors import new_detector
from retrolidar_ros.evaluation.live import (
    PlaceError,
    held,
    millimetres,
    place_error,
    read_live,
    told_held,
)
from retrolidar_ros.evaluation.statistics import rate
from retrolidar_ros.frame import Floats, Recording
from retrolidar_ros.heartbeat import WINDOW_S, Heartbeat
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.optics import position_at, zone_shares
from retrolidar_ros.truth import PACKET_S, moments
from retrolidar_ros.yaml_files import load_scene

SHOWN = ('joint', 'paper')
"""Whose readings are drawn over time."""
PAPER_RATE, PAPER_RANGE_MM = 0.91, 10.0
"""Of windows of 10 s with a reading; and what range errors stay below."""
_WINDOWS_S = (2.0, 5.0, WINDOW_S)
_RUNS, _QUICK_RUNS = 4, 1
_QUICK_DURATION_S = 40.0
_STEP_S = 0.02  # in which the motion is told


def places_during(marker: Marker, detection: Detection) -> Floats:
    """Return where a marker was while it was read [m], shape (32, 3).

    The stamps are those of a simulation whose sensor's clock is right.
    """
    times_s = 1e-9 * moments(detection.stamp_ns, detection.packets)
    return np.broadcast_to(position_at(marker, times_s), (len(times_s), 3))


class Reading(NamedTuple):
    """One reading of the drone."""

    known_s: float
    """From the first frame until it came."""
    moment_s: float
    """Middle of what it was read from, from the first frame."""
    place: Place
    """As measured."""
    error: PlaceError


class Flight(NamedTuple):
    """What one method made of one run."""

    readings: list[Reading]
    wrong_ids: int
    """IDs that the drone did not send."""
    rejected: Counter[str]
    """What the method did not read, by reason."""


def follow(method: str, recording: Recording, marker: Marker) -> Flight:
    """Read all frames of a run, one by one."""
    detector = new_detector(method, recording.grid)
    origin_ns = int(recording.stamp_ns[0])
    readings = []
    wrong_ids = 0
    for known_ns, detection in read_live(detector, recording):
        if detection.id != marker.id:
            wrong_ids += 1
            continue
        length_s = detection.packets * PACKET_S
        readings.append(
            Reading(
                known_s=(known_ns - origin_ns) * 1e-9,
                moment_s=(detection.stamp_ns - origin_ns) * 1e-9 - length_s / 2,
                place=detection.place,
                error=place_error(detection.place, places_during(marker, detection)),
            )
        )
    return Flight(readings, wrong_ids, detector.counts.rejected)


def heartbeat_of(readings: list[Reading], duration_s: float, window_s: float) -> Heartbeat:
    """Return the heartbeats of a run, counted in windows of a length [s]."""
    heartbeat = Heartbeat(window_s)
    heartbeat.advance(0.0)
    for reading in readings:
        heartbeat.beat(reading.known_s)
    heartbeat.advance(duration_s)
    return heartbeat


def silences(readings: list[Reading], duration_s: float) -> list[float]:
    """Return the times without a reading [s], those at both ends of the run included."""
    times_s = [0.0, *(reading.known_s for reading in readings), duration_s]
    return [later - earlier for earlier, later in itertools.pairwise(times_s)]


def motion(scene: Scene, duration_s: float) -> dict[str, Any]:
    """Return how far the drone drifts, and how often another zone sees it best."""
    (marker,) = scene.markers
    times_s = np.arange(0, duration_s, _STEP_S)
    places_m = position_at(marker, times_s)
    shares = zone_shares(places_m, marker.size_m, scene.sensor.grid, scene.sensor.blur)
    best = shares.argmax(axis=1)
    return {
        'span_m': np.ptp(places_m, axis=0).round(4).tolist(),
        'zones': np.unique(best).tolist(),
        'crossings': int(np.count_nonzero(np.diff(best))),
    }


def _figures(flights: list[Flight], duration_s: float) -> dict[str, Any]:
    """Sum up the runs of one method."""
    windows = []
    for window_s in _WINDOWS_S:
        counted = [heartbeat_of(one.readings, duration_s, window_s) for one in flights]
        alive = rate(sum(one.windows_alive for one in counted), sum(one.windows for one in counted))
        windows.append({'window_s': window_s, 'alive': alive})
    silences_s = [gap for one in flights for gap in silences(one.readings, duration_s)]
    first = flights[0].readings
    readings = [reading for one in flights for reading in one.readings]
    return {
        'readings': len(readings),
        'readings_per_s': len(readings) / (len(flights) * duration_s),
        'windows': windows,
        'silences_s': np.sort(np.round(silences_s, 3)).tolist(),
        'range_mm': millimetres([reading.error.range_m for reading in readings]),
        'position_mm': millimetres([reading.error.position_m for reading in readings]),
        'bearing_deg': np.round([reading.error.bearing_deg for reading in readings], 3).tolist(),
        'ellipsoid_holds': held([reading.error.squared_distance for reading in readings]),
        'wrong_ids': sum(one.wrong_ids for one in flights),
        'rejected': dict(sum((one.rejected for one in flights), Counter[str]())),
        'first_run': {
            'known_s': [round(reading.known_s, 3) for reading in first],
            'moment_s': [round(reading.moment_s, 3) for reading in first],
            'range_m': [round(reading.place.range_m, 4) for reading in first],
            'place_m': [np.round(reading.place.position_m, 4).tolist() for reading in first],
        },
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return heartbeats, silences and errors of every method in the same runs."""
    scene = load_scene('drone')
    (marker,) = scene.markers
    runs = _QUICK_RUNS if quick else _RUNS
    duration_s = min(_QUICK_DURATION_S, scene.duration_s) if quick else scene.duration_s
    flights: dict[str, list[Flight]] = {method: [] for method in METHODS}
    with tqdm(total=runs * len(METHODS), desc='drone', leave=False) as progress:
        for _ in range(runs):
            recording = Simulation(scene, rng).run(duration_s)
            for method in METHODS:
                flights[method].append(follow(method, recording, marker))
                progress.update()
    return {
        'runs': runs,
        'duration_s': duration_s,
        'motion': motion(scene, duration_s),
        'paper': {'rate': PAPER_RATE, 'window_s': WINDOW_S, 'range_mm': PAPER_RANGE_MM},
        'methods': {method: _figures(rows, duration_s) for method, rows in flights.items()},
    }


def _told(signed: list[float]) -> str:
    """Return the root mean square and the largest size of errors as text."""
    if not signed:
        return 'unknown'
    return f'{np.sqrt(np.mean(np.square(signed))):.1f} rms, {np.abs(signed).max():.1f} worst'


def summarise(figures: dict[str, Any]) -> str:
    """Return the figures as lines of text."""
    moved, paper = figures['motion'], figures['paper']
    across_x, across_y, along = (100 * span_m for span_m in moved['span_m'])
    drift = f'{across_x:.0f} × {across_y:.0f} × {along:.0f} cm'
    crossings = f'{moved["crossings"]} times into another of {len(moved["zones"])} zones'
    windows = f'{paper["rate"]:.0%} of windows of {paper["window_s"]:g} s'
    lines = [
        f'{figures["runs"]} runs of {figures["duration_s"]:g} s, drift of {drift}, {crossings}',
        f'the paper reports a reading in {windows}, range errors below {paper["range_mm"]:g} mm',
    ]
    for method, row in figures['methods'].items():
        alive = ', '.join(
            f'{one["alive"]["rate"]:.1%} of {one["window_s"]:g} s' for one in row['windows']
        )
        good = sum(abs(error) < paper['range_mm'] for error in row['range_mm'])
        below = f'{good}/{row["readings"]} below {paper["range_mm"]:g} mm'
        bearing = f'of bearing {_told(row["bearing_deg"])} [°]'
        rejected = ', '.join(f'{count} {reason}' for reason, count in row['rejected'].items())
        lines += [
            f'{method}: a reading in {alive} windows, {row["readings_per_s"]:.2f} readings/s',
            f'  longest silence {row["silences_s"][-1]:.1f} s, {row["wrong_ids"]} wrong IDs',
            f'  error of range {_told(row["range_mm"])} [mm], {below}',
            f'  error of position {_told(row["position_mm"])} [mm], {bearing}',
            f'  {told_held(row["ellipsoid_holds"])}',
            f'  candidates not read: {rejected or "none"}',
        ]
    return '\n'.join(lines)


def _draw_track(axis: Any, figures: dict[str, Any], truth: Floats, key: str, index: int) -> None:
    """Draw one coordinate of the first run over time: the truth as a line, readings as dots."""
    times_s = np.linspace(0, figures['duration_s'], len(truth))
    axis.plot(times_s, truth, color='0.55', linewidth=1.2)
    for method in reversed(SHOWN):
        first = figures['methods'][method]['first_run']
        values = np.array(first[key]).reshape(len(first['moment_s']), -1)
        axis.plot(first['moment_s'], values[:, index], linestyle='', alpha=0.8, **look(method))
    axis.set_xlim(0, figures['duration_s'])
    axis.set_xlabel('time [s]')


def _draw_silences(axis: Any, figures: dict[str, Any]) -> None:
    """Draw how much of the time belongs to silences longer than each."""
    longest_s = max(row['silences_s'][-1] for row in figures['methods'].values())
    edges = np.linspace(0, longest_s, 300)
    for method, row in figures['methods'].items():
        silences_s = np.array(row['silences_s'])
        share = [100 * silences_s[silences_s > edge].sum() / silences_s.sum() for edge in edges]
        axis.plot(edges, share, color=look(method)['color'])
    axis.axvline(WINDOW_S, color='0.4', linestyle='--', linewidth=1)
    axis.text(WINDOW_S + 0.2, 90, 'a window', color='0.3', fontsize=10)
    axis.set_xlim(0, 1.03 * longest_s)
    axis.set_xlabel('silence [s]')
    axis.set_ylabel('time spent in longer silences [%]')
    axis.set_title('how long silences last, all runs')


def _draw_heartbeats(axis: Any, figures: dict[str, Any]) -> None:
    """Draw when each method read in the first run, one line each."""
    names = list(figures['methods'])
    for index, method in enumerate(names):
        known_s = figures['methods'][method]['first_run']['known_s']
        axis.vlines(known_s, index - 0.35, index + 0.35, color=look(method)['color'], linewidth=1.2)
    axis.set_yticks(range(len(names)))
    axis.set_yticklabels(names)
    axis.invert_yaxis()
    axis.grid(axis='y', visible=False)
    axis.set_xlim(0, figures['duration_s'])
    axis.set_xlabel('time [s]')
    axis.set_title('readings of the first run')


def _draw_windows(axis: Any, figures: dict[str, Any]) -> None:
    """Draw the shares of windows with a reading, with their confidence."""
    width = 0.8 / len(figures['methods'])
    for index, (method, row) in enumerate(figures['methods'].items()):
        rates = [one['alive'] for one in row['windows']]
        places = np.arange(len(rates)) - 0.4 + width * (index + 0.5)
        shares = np.array([one['rate'] for one in rates])
        # Rounding may put a share of all beside its own bound.
        above = np.maximum([one['high'] for one in rates] - shares, 0)
        below = np.maximum(shares - [one['low'] for one in rates], 0)
        axis.bar(places, 100 * shares, 0.9 * width, color=look(method)['color'])
        axis.errorbar(
            places, 100 * shares, [100 * below, 100 * above], fmt='none', ecolor='0.2', capsize=2
        )
    paper = figures['paper']
    last = len(_WINDOWS_S) - 1
    axis.plot(
        [last - 0.45, last + 0.45],
        [100 * paper['rate']] * 2,
        color='0',
        linestyle='--',
        linewidth=2,
        label=f'the paper reports {paper["rate"]:.0%}',
    )
    axis.legend(loc='upper left', fontsize=10)
    axis.set_xticks(range(len(_WINDOWS_S)))
    axis.set_xticklabels([f'{window_s:g} s' for window_s in _WINDOWS_S])
    axis.set_ylim(0, 119)  # with room for the legend
    axis.set_yticks(range(0, 101, 20))
    axis.grid(axis='x', visible=False)
    axis.set_xlabel('length of a window')
    axis.set_ylabel('windows with a reading [%]')
    axis.set_title('heartbeats, all runs, 95 % confidence')


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw range and place over time, silences, and windows with a reading."""
    (marker,) = load_scene('drone').markers
    truth_m = position_at(marker, np.arange(0, figures['duration_s'], _STEP_S))
    figure, axes = new_chart(3, 2, 16, 12)
    _draw_track(axes[0, 0], figures, np.linalg.norm(truth_m, axis=1), 'range_m', 0)
    _draw_track(axes[1, 0], figures, truth_m[:, 0], 'place_m', 0)
    _draw_track(axes[2, 0], figures, truth_m[:, 1], 'place_m', 1)
    dots = ' and '.join(SHOWN)
    axes[0, 0].set_title(f'first run: truth (line) and readings of {dots} (dots)')
    for axis, label in zip(axes[:, 0], ('range [m]', 'x [m]', 'y [m]'), strict=True):
        axis.set_ylabel(label)
    _draw_heartbeats(axes[0, 1], figures)
    _draw_silences(axes[1, 1], figures)
    _draw_windows(axes[2, 1], figures)
    shared_legend(figure, 'A drone that drifts over four zones, and whose rotor hides it', [])
    figure.savefig(path)
