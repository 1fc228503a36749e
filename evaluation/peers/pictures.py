# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of visual markers, and what readers make of them."""

import math
import time
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple, TypedDict

import numpy as np

from evaluation.bench.rates import Rate, rate
from evaluation.bench.recordings import rng_at
from evaluation.peers import camera
from evaluation.peers.camera import Background, Window
from evaluation.peers.visual_markers import IDS, Reader
from retrolidar_ros.sensor.frame import Floats

PICTURES, QUICK_PICTURES = 96, 8  # of a marker of 3 cm at a range
_MAX_ROLL_RAD = math.radians(10)


class View(NamedTuple):
    """How a marker is seen."""

    range_m: float
    size_m: float = 0.03  # edge of the pattern
    lux: float = 300.0  # a room with its lamps on
    veil: float = 0.0  # of glare, in shares of white paper
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    speed_m_s: float = 0.0  # across the line of sight
    longest_s: float = camera.LONGEST_EXPOSURE_S  # exposure that the camera takes at most


class Error(TypedDict):
    """Absolute errors of range [mm]."""

    median: float
    largest: float
    above_1_cm: float  # share of them


class Result(TypedDict):
    """What one reader made of the pictures of one view."""

    right: Rate  # of single pictures
    wrong: Rate  # of pictures in which an ID was read that was not there
    error_mm: Error | None  # of the right readings, if any


def errors(errors_m: Sequence[float]) -> Error | None:
    """Return how large errors [m] are, if there are any."""
    if not len(errors_m):
        return None
    sizes = 1000 * np.abs(errors_m)
    return Error(
        median=float(np.median(sizes)),
        largest=float(sizes.max()),
        above_1_cm=float(np.mean(sizes > 10)),
    )


def read_pictures(
    readers: Sequence[Reader],
    background: Background,
    pictures: int,
    rng: np.random.Generator,
    view: View,
) -> dict[str, Result]:
    """Take pictures of markers at random places of the camera's view, and let all read them.

    Readers of one kind of marker get the same pictures.
    """
    results = {}
    for _, group in groupby(readers, key=attrgetter('kind')):
        alike = list(group)
        hits = {reader.name: 0 for reader in alike}
        wrong = dict(hits)
        errors_m: dict[str, list[float]] = {reader.name: [] for reader in alike}
        for _ in range(pictures):
            identity = int(rng.integers(IDS))
            light, window = _marker_before(background, alike[0], identity, view, rng)
            picture = camera.expose(light, view.lux, rng, veil=view.veil, longest_s=view.longest_s)
            for reader in alike:
                sightings = reader.read(picture, window.centre_px, view.size_m)
                right = [seen.range_m - view.range_m for seen in sightings if seen.id == identity]
                hits[reader.name] += bool(right)
                wrong[reader.name] += len(sightings) > len(right)
                errors_m[reader.name] += right
        for name, count in hits.items():
            results[name] = Result(
                right=rate(count, pictures),
                wrong=rate(wrong[name], pictures),
                error_mm=errors(errors_m[name]),
            )
    return results


def read_over_distance(
    readers: Sequence[Reader], ranges_m: Sequence[float], seed: int, *, quick: bool
) -> list[dict[str, Result]]:
    """Return what readers make of markers of 3 cm at some ranges [m].

    At a range every experiment has the same pictures, so a reader's reach is the same in all.
    """
    background = Background(np.random.default_rng(seed))
    pictures = QUICK_PICTURES if quick else PICTURES
    return [
        read_pictures(readers, background, pictures, rng_at(seed, at), View(at)) for at in ranges_m
    ]


def _marker_before(
    background: Background, reader: Reader, identity: int, view: View, rng: np.random.Generator
) -> tuple[Floats, Window]:
    """Return the light around a marker at a random place, wholly in the picture."""
    plate = reader.plate(identity, view.size_m)
    pose = camera.facing_pose(
        view.range_m, camera.FOCAL_PX * plate.side_m / view.range_m, _MAX_ROLL_RAD, rng
    )
    pose = camera.tilted(pose, math.radians(view.yaw_deg), math.radians(view.pitch_deg))
    light, window = background.with_plate(plate.cells, plate.side_m, pose)
    if view.speed_m_s:
        # The camera follows the background as little as the marker does.
        open_s = camera.exposure_s(view.lux, view.longest_s)
        light = camera.smear(light, camera.FOCAL_PX * view.speed_m_s * open_s / view.range_m)
    return light, window


def picture_cost(
    reader: Reader, background: Background, pictures: int, rng: np.random.Generator, view: View
) -> float:
    """Return the processor time per second of watching [ms], of whole pictures."""
    spent_s = 0.0
    for _ in range(pictures):
        light, window = _marker_before(background, reader, int(rng.integers(IDS)), view, rng)
        whole = background.light.copy()
        whole[window.slices] = light
        picture = camera.expose(whole, view.lux, rng)
        began_s = time.process_time()
        reader.read(picture, camera.CENTRE_PX, view.size_m)
        spent_s += time.process_time() - began_s
    return 1000 * camera.PICTURES_HZ * spent_s / pictures
