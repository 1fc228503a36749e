# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How steadily a hovering drone is read, and how well it is ranged (paper §7.2)."""

from __future__ import annotations

import itertools
from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from evaluation.bench.detectors import new_detector
from evaluation.bench.live import (
    PlaceError,
    held,
    millimetres,
    place_error,
    read_live,
    told_held,
)
from evaluation.bench.rates import rate
from evaluation.experiments.drone_chart import SHOWN, draw
from evaluation.report.claims import NOTHING, Claim
from retrolidar_ros.detector import METHODS, Detection
from retrolidar_ros.detector.place import Place
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.optics import position_at, zone_shares
from retrolidar_ros.sensor.frame import Floats, Recording
from retrolidar_ros.tasks.heartbeat import WINDOW_S, Heartbeat

__all__ = ['SOURCE', 'TITLE', 'comment', 'compare', 'draw', 'run', 'summarise']

TITLE = 'Drone'
SOURCE = 'paper §7.2, Fig. 13b'

PAPER_RATE, PAPER_RANGE_MM = 0.91, 10.0
"""Of windows of 10 s with a reading; and what range errors stay below."""
_WINDOWS_S = (2.0, 5.0, WINDOW_S)
_RUNS, _QUICK_RUNS = 4, 1
_QUICK_DURATION_S = 40.0
_STEP_S = 0.02  # in which the motion is told


def true_place(marker: Marker, detection: Detection) -> Floats:
    """Return where a marker was at the stamp of a reading [m], shape (3,).

    The stamps are those of a simulation whose sensor's clock is right.
    """
    place_m: Floats = position_at(marker, np.array([1e-9 * detection.stamp_ns])).reshape(3)
    return place_m


class Reading(NamedTuple):
    """One reading of the drone."""

    known_s: float
    """From the first frame until it came."""
    moment_s: float
    """When its place holds, from the first frame."""
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
        readings.append(
            Reading(
                known_s=(known_ns - origin_ns) * 1e-9,
                moment_s=(detection.stamp_ns - origin_ns) * 1e-9,
                place=detection.place,
                error=place_error(detection.place, true_place(marker, detection)),
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


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set heartbeats and errors beside the paper's."""
    paper = figures['paper']
    both = [figures['methods'][method] for method in reversed(SHOWN)]

    def windows(row: dict[str, Any], length_s: float) -> str:
        found = [one for one in row['windows'] if one['window_s'] == length_s]
        return f'{found[0]["alive"]["rate"]:.0%}'

    def errors(row: dict[str, Any]) -> str:
        range_mm = np.array(row['range_mm'])
        if not len(range_mm):
            return NOTHING
        rms = float(np.sqrt(np.mean(range_mm**2)))
        return f'{rms:.1f} and {np.abs(range_mm).max():.1f} mm'

    def position(row: dict[str, Any]) -> str:
        if not row['position_mm']:
            return NOTHING
        return f'{float(np.sqrt(np.mean(np.square(row["position_mm"])))):.0f} mm'

    return [
        Claim(
            f'windows of {paper["window_s"]:g} s with a reading',
            f'{paper["rate"]:.0%}',
            *(windows(row, paper['window_s']) for row in both),
        ),
        Claim('longest silence', 'not told', *(f'{row["silences_s"][-1]:.1f} s' for row in both)),
        Claim(
            'error of the range, rms and worst',
            f'below {paper["range_mm"]:g} mm',
            *(errors(row) for row in both),
        ),
        Claim(
            'error of the position, rms',
            'not told; visual markers above 160 mm',
            *(position(row) for row in both),
        ),
        Claim(
            f'wrong IDs in {figures["runs"]} times {figures["duration_s"]:g} s',
            'not told',
            *(f'{row["wrong_ids"]}' for row in both),
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say what was simulated, and what is not reached in short windows."""
    short = figures['methods']['joint']['windows'][0]
    motion = figures['motion']
    return (
        f'The drone drifts by {100 * motion["span_m"][0]:.0f} × {100 * motion["span_m"][1]:.0f} cm '
        f'over {len(motion["zones"])} zones, and its rotor hides the marker again and again, as '
        f'`config/scenes/drone.yaml` has it. Of windows of {short["window_s"]:g} s only '
        f'{short["alive"]["rate"]:.0%} have a reading. The paper counts windows in which a '
        'heartbeat is detected, and its path and rotor are not known: as both methods have a '
        'reading in every long window here, this flight is easier than that of the paper.'
    )
