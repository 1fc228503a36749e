# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of LiDAR markers and of visual markers at one place, and what they cost."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from operator import attrgetter
from typing import TypedDict

import numpy as np

from evaluation.bench.rates import Rate, rate
from evaluation.experiments.reach import trial_at
from evaluation.peers.camera import (
    CENTRE_PX,
    FOCAL_PX,
    PICTURES_HZ,
    Background,
    Window,
    expose,
    facing_pose,
)
from evaluation.peers.visual_markers import IDS, Reader
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.sensor.frame import Floats

PACKET_S = PACKET_BITS * BIT_PERIOD_S
PICTURES_OF_A_PACKET = round(PACKET_S * PICTURES_HZ)
TALKING = 3
_MAX_ROLL_RAD = math.radians(10)
_WARM_UP_FRAMES = 500  # as many as a detector keeps


class Error(TypedDict):
    """Absolute errors of range [mm]."""

    median: float
    p95: float
    largest: float


class Result(TypedDict):
    """What one method or reader made of the markers of one place."""

    read: Rate
    """Of single packets, or single pictures."""
    in_packet_time: float
    """Share read within the time of one packet."""
    wrong: int
    """Readings of IDs that were not there."""
    error_mm: Error | None
    """Of the right readings, if any."""


def errors(errors_m: Sequence[float]) -> Error | None:
    """Return how large errors [m] are, if there are any."""
    if not errors_m:
        return None
    sizes = 1000 * np.abs(errors_m)
    median, p95 = np.percentile(sizes, [50, 95])
    return Error(median=float(median), p95=float(p95), largest=float(sizes.max()))


def in_some(hits: int, trials: int, chosen: int) -> float:
    """Return the chance that among some of the trials, chosen at random, there is a hit.

    With fewer trials than are to be chosen, it is that of all of them.
    """
    chosen = min(chosen, trials)
    return 1 - math.comb(trials - hits, chosen) / math.comb(trials, chosen)


def read_lidar(
    range_m: float, size_m: float, scenes: int, rng: np.random.Generator
) -> dict[str, Result]:
    """Wake a marker in each zone for one packet, and let every method read it.

    Parameters
    ----------
    range_m, size_m : float
        Of the markers [m].
    scenes : int
        How often, with other IDs and noise.
    rng : numpy.random.Generator
        Of the scenes.
    """
    hits = dict.fromkeys(METHODS, 0)
    wrong = dict.fromkeys(METHODS, 0)
    errors_m: dict[str, list[float]] = {method: [] for method in METHODS}
    for _ in range(scenes):
        trial = trial_at(range_m, size_m, 1, rng)
        own = {marker.id: zone for zone, marker in enumerate(trial.scene.markers)}
        for method in METHODS:
            found = set()
            detector = create_detector(method, trial.recording.grid, max_packets=1)
            for detection in detector.update_all(trial.recording):
                if own.get(detection.id) == detection.zones[0]:
                    found.add(detection.id)
                    errors_m[method].append(detection.place.range_m - range_m)
                else:
                    wrong[method] += 1
            hits[method] += len(found)
    results = {}
    for method in METHODS:
        share = rate(hits[method], scenes * SENSOR.grid.zones)
        results[method] = Result(
            read=share,
            in_packet_time=share['rate'],
            wrong=wrong[method],
            error_mm=errors(errors_m[method]),
        )
    return results


def read_pictures(
    readers: Sequence[Reader],
    background: Background,
    pictures: int,
    rng: np.random.Generator,
    *,
    range_m: float,
    size_m: float,
    lux: float,
    veil: float = 0.0,
    gamma: float = 1.0,
) -> dict[str, Result]:
    """Take pictures of markers at random places of the camera's view, and let all read them.

    Only the marker's surroundings are exposed and read: thresholds are local, so that the rest of
    the picture would only cost time.

    Parameters
    ----------
    readers : sequence of Reader
        Those of one kind one after the other; they read the same pictures.
    background : Background
        Behind the markers.
    pictures : int
        How many, for each kind of marker.
    rng : numpy.random.Generator
        Of IDs, places and noise.
    range_m, size_m : float
        Of the markers [m].
    lux, veil, gamma : float
        See `expose`.
    """
    results = {}
    for _, group in groupby(readers, key=attrgetter('kind')):
        alike = list(group)
        hits = dict.fromkeys(alike, 0)
        wrong = dict.fromkeys(alike, 0)
        errors_m: dict[Reader, list[float]] = {reader: [] for reader in alike}
        for _ in range(pictures):
            identity = int(rng.integers(IDS))
            light, window = _marker_before(background, alike[0], identity, range_m, size_m, rng)
            picture = expose(light, lux, rng, veil=veil, gamma=gamma)
            for reader in alike:
                sightings = reader.read(picture, window.centre_px, size_m)
                right = [seen.range_m - range_m for seen in sightings if seen.id == identity]
                hits[reader] += bool(right)
                wrong[reader] += len(sightings) - len(right)
                errors_m[reader] += right
        for reader in alike:
            results[reader.name] = Result(
                read=rate(hits[reader], pictures),
                in_packet_time=in_some(hits[reader], pictures, PICTURES_OF_A_PACKET),
                wrong=wrong[reader],
                error_mm=errors(errors_m[reader]),
            )
    return results


def _marker_before(
    background: Background,
    reader: Reader,
    identity: int,
    range_m: float,
    size_m: float,
    rng: np.random.Generator,
) -> tuple[Floats, Window]:
    """Return the light around a marker at a random place, wholly in the picture."""
    plate = reader.plate(identity, size_m)
    pose = facing_pose(range_m, FOCAL_PX * plate.side_m / range_m, _MAX_ROLL_RAD, rng)
    return background.with_plate(plate.cells, plate.side_m, pose)


def picture_cost(
    readers: Sequence[Reader],
    background: Background,
    pictures: int,
    rng: np.random.Generator,
    *,
    range_m: float,
    size_m: float,
    lux: float,
) -> tuple[dict[str, float], int]:
    """Let all read whole pictures.

    Returns
    -------
    cpu_ms : dict
        Processor time per second of watching [ms], by reader.
    wrong : int
        Readings of IDs that were not there, of all readers.
    """
    spent_s = {reader.name: 0.0 for reader in readers}
    wrong = 0
    for _ in range(pictures):
        for reader in readers:
            identity = int(rng.integers(IDS))
            light, window = _marker_before(background, reader, identity, range_m, size_m, rng)
            whole = background.light.copy()
            whole[window.slices] = light
            picture = expose(whole, lux, rng)
            began_s = time.process_time()
            sightings = reader.read(picture, CENTRE_PX, size_m)
            spent_s[reader.name] += time.process_time() - began_s
            wrong += sum(seen.id != identity for seen in sightings)
    return {name: 1000 * PICTURES_HZ * cost / pictures for name, cost in spent_s.items()}, wrong


def frame_cost(
    range_m: float, size_m: float, markers: int, frames: int, rng: np.random.Generator
) -> dict[str, float]:
    """Return the processor time per second of watching [ms] of every method.

    Parameters
    ----------
    range_m, size_m : float
        Of the markers [m].
    markers : int
        How many talk without end.
    frames : int
        How many are timed, one by one as they come from a sensor.
    rng : numpy.random.Generator
        Of the scene.
    """
    scene = marker_in_each_zone(range_m, rng, start_s=(-PACKET_S, 0.0), packets=None, size_m=size_m)
    scene = replace(scene, markers=scene.markers[:markers])
    simulation = Simulation(scene, rng)
    before = simulation.advance(_WARM_UP_FRAMES)
    timed = simulation.advance(frames)
    watched_s = (timed.stamp_ns[-1] - before.stamp_ns[-1]) / 1e9
    costs = {}
    for method in METHODS:
        detector = create_detector(method, scene.sensor.grid)
        detector.update_all(before)
        began_s = time.process_time()
        for frame in timed:
            detector.update(frame)
        costs[method] = float(1000 * (time.process_time() - began_s) / watched_s)
    return costs
