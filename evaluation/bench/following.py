# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in which markers are followed: two in one zone, and one that ends."""

from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.judging import Step, watch
from evaluation.bench.places import median_mm, rms_mm
from evaluation.bench.recordings import Sent, record, record_at, standing
from evaluation.bench.stresses import PLAIN
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.methods import create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.reference import RESPONSE, SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Recording, ZoneGrid


def play(recording: Recording) -> tuple[LikelihoodDetector, list[Step]]:
    """Return a detector that has followed the markers of a recording, and what came with frames."""
    detector = create_detector('joint', recording.grid)
    assert isinstance(detector, LikelihoodDetector)
    return detector, list(watch(detector, recording, follow=True))


def walls(range_m: float, grid: ZoneGrid, signal: float = WALL_SIGNAL) -> tuple[Surface, ...]:
    """Return a background in every zone at the distance that the sensor reports for a range."""
    return tuple(
        Surface(float(range_m * factor), signal, (zone,))
        for zone, factor in enumerate(grid.z_per_range)
    )


SECONDS_S = {'from the start': (-1.3, 0.0), 'after 3 to 5 s': (3.0, 5.0)}
"""When the second marker begins to send [s]."""
_ZONE = 9
_OFF_ZONES = 0.3  # markers are so far from the middle of the zone, at most
_WALL_M = 0.1  # behind the first
_SETTLED_S = 1.0


def two_in_a_zone(
    range_m: float, apart_m: float, begins: str, duration_s: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return errors of two markers, of which the second is `apart_m` farther, and their ends.

    `begins` is a key of `SECONDS_S`. Errors are those of frames a second and more after the first
    track began.
    """
    grid = SENSOR.grid
    tangents = grid.tangents[_ZONE] + rng.uniform(-_OFF_ZONES, _OFF_ZONES, (2, 2)) * grid.pitch
    ids = rng.choice(USABLE_IDS, 2, replace=False)
    starts_s = [rng.uniform(-1.3, 0.0), rng.uniform(*SECONDS_S[begins])]
    markers = tuple(
        Marker(int(one), (z * x, z * y, z), start_s=float(start_s), response=RESPONSE)
        for one, start_s, z, (x, y) in zip(
            ids, starts_s, (range_m, range_m + apart_m), tangents.tolist(), strict=True
        )
    )
    scene = Scene(sensor=SENSOR, markers=markers, surfaces=walls(range_m + _WALL_M, grid))
    detector, steps = play(Simulation(scene, rng).run(duration_s))
    truths_m = {one.id: float(np.linalg.norm(one.position_m)) for one in markers}
    known = [{one.id for one in step.tracks} & {*truths_m} for step in steps]
    first = next((at for at, one in enumerate(known) if one), len(known))
    settled = steps[first + round(_SETTLED_S / SENSOR.period_s) :]
    own = [one for step in settled for one in step.tracks if one.id in truths_m]
    sending = max(first, round(max(starts_s[1], 0.0) / SENSOR.period_s))
    return {
        'errors_m': [one.place.range_m - truths_m[one.id] for one in own],
        'both': [len(one) == len(truths_m) for one in known[sending:]],
        'ends': detector.counts.tracks_ended,
        'hours': len(known[first:]) * SENSOR.period_s / 3600,
    }


def shared_figures(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the statistics of several runs of `two_in_a_zone`."""
    errors_m, both = ([value for one in runs for value in one[of]] for of in ('errors_m', 'both'))
    hours = sum(one['hours'] for one in runs)
    return {
        'median_mm': median_mm(errors_m),
        'rms_mm': rms_mm(errors_m),
        'both_followed': float(np.mean(both)) if both else None,
        'ends_an_hour': sum(one['ends'] for one in runs) / hours if hours else None,
    }


ENDS = ('vanishes', 'sends another ID', 'stays bright')
_KNOWN_S, _AFTER_S = 3.0, 2.5  # a marker repeats so long before it ends, and is watched after it


def _spliced(before: Recording, after: Recording, frame: int) -> Recording:
    """Return one recording up to a frame, and another one from there on."""
    arrays = {
        name: np.concatenate([values[:frame], getattr(after, name)[frame:]])
        for name, values in vars(before).items()
        if name != 'grid'
    }
    return replace(before, **arrays)


def _all_bright(recording: Recording, rng: np.random.Generator) -> Recording:
    """Return as many frames, drawn from those in which the marker is bright."""
    signal = recording.signal[:, recording.signal.std(axis=0).argmax()]
    dark, bright = np.quantile(signal, (0.1, 0.9))
    kept = np.flatnonzero(signal > dark + 0.9 * (bright - dark))
    rows = rng.choice(kept, len(signal))
    seen = {name: getattr(recording, name)[rows] for name in ('signal', 'distance', 'status')}
    return replace(recording, **seen)


def dropped_s(range_m: float, rng: np.random.Generator, *, end: str) -> float | None:
    """Return how long a marker is followed after one of the `ENDS` [s].

    None if it was not followed.
    """
    lasting_s, path = _KNOWN_S + _AFTER_S, standing(range_m * SENSOR.grid.directions[_ZONE])

    def sent() -> Sent:
        return record_at(range_m, rng, path=path, repeated_s=lasting_s)

    own = sent()
    if end == 'vanishes':
        after = record(PLAIN, 1e-6, rng, range_m=range_m, repeated_s=lasting_s).recording
    else:
        after = _all_bright(own.recording, rng) if end == 'stays bright' else sent().recording
    frame = round((_KNOWN_S + 1.3 * rng.random()) / SENSOR.period_s)
    _, steps = play(_spliced(own.recording, after, frame))
    known = [any(one.id == own.ids[0] for one in step.tracks) for step in steps]
    if not known[frame - 1]:
        return None
    last = next((index for index in range(frame, len(known)) if not known[index]), len(known))
    return (last - frame) * SENSOR.period_s
