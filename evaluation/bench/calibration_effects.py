# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the detector gains by knowing a parameter of its sensor or markers, over its real range."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import SIGNAL_AT_1_M, Marker, Noise, Surface
from retrolidar_ros.scene.marker_budget import NEEDED_SNR_DB, needed_swing
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT
from retrolidar_ros.scene.reference import NOISE, RANGING, RESPONSE, SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Recording, ZoneGrid

_SECONDS = 4.0
_BLUR = 0.1  # of other parameters' scenes
_RANGES = (0.4, 1.2)  # over that to which 80 % of lone packets are read
_BEHIND_M = 0.02


class Known(NamedTuple):
    """A value of a parameter: scenes that have it, and what the detector is then told."""

    scene: Callable[[Scene], Scene]
    told: dict[str, float]
    noise: Noise = NOISE


def _scene(known: Known, rng: np.random.Generator) -> Scene:
    """Return one marker anywhere in the view, as far as it is read or a little farther."""
    reach_m = (needed_swing(NEEDED_SNR_DB, known.noise) / SIGNAL_AT_1_M) ** (1 / DISTANCE_EXPONENT)
    half = SENSOR.grid.view / 2
    ray = np.append(rng.uniform(-half, half, 2), 1.0)
    place_m = reach_m * rng.uniform(*_RANGES) * ray / np.linalg.norm(ray)
    x, y, z = place_m.tolist()
    start_s = float(-rng.uniform(0, PACKET_BITS * BIT_PERIOD_S))
    marker = Marker(int(rng.choice(USABLE_IDS)), (x, y, z), start_s=start_s, response=RESPONSE)
    wall = Surface(z + _BEHIND_M, WALL_SIGNAL)
    return Scene(sensor=replace(SENSOR, blur=_BLUR), markers=(marker,), surfaces=(wall,))


def _sensor(scene: Scene, **changes: Any) -> Scene:
    return replace(scene, sensor=replace(scene.sensor, **changes))


def _bit_period(ms: float) -> Known:
    def changed(scene: Scene) -> Scene:
        (marker,) = scene.markers
        return replace(scene, markers=(replace(marker, bit_period_s=1e-3 * ms),))

    return Known(changed, {'bit_period': 1e-3 * ms})


def _noise(scale: float) -> Known:
    law = Noise(*(scale * one for one in (NOISE.floor, NOISE.slope, NOISE.slope)))
    told = {'noise_floor': law.floor, 'noise_slope': law.slope, 'noise_ambient': law.ambient}
    return Known(lambda scene: _sensor(scene, noise=law), told, law)


def _offset(mm: float) -> Known:
    ranging = replace(RANGING, offset=1e-3 * mm)
    return Known(lambda scene: _sensor(scene, ranging=ranging), {'range_offset': 1e-3 * mm})


def _pitch(share: float) -> Known:
    pitch = (1 + 0.01 * share) * SENSOR.grid.pitch
    grid = ZoneGrid(view=pitch * SENSOR.grid.columns)
    return Known(lambda scene: _sensor(scene, grid=grid), {'zone_pitch': pitch})


def _blur(share: float) -> Known:
    blur = 0.01 * share
    return Known(lambda scene: _sensor(scene, blur=blur), {'zone_blur': blur})


PARAMETERS: dict[str, tuple[str, tuple[float, ...], Callable[[float], Known]]] = {
    'bit period': ('ms', (40, 60, 120), _bit_period),
    'noise': ('times the usual', (1 / 8, 1 / 2, 2, 8, 16), _noise),
    'range offset': ('mm', (-30, 5, 30), _offset),
    'zone pitch': ('%', (-2, 2), _pitch),
    'zone blur': ('% of a zone', (3, 10, 25), _blur),
}
"""Unit, values over the range that sensors and markers have, and what they change."""


def _first(recording: Recording, values: dict[str, float], id_: int) -> Detection | None:
    found = Decoding({**defaults(), **values}).detect(recording)
    return next((one for one in found if one.id == id_), None)


def effect(name: str, value: float, markers: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what a detector gains that is told a value.

    These are the shares of the markers that are read by default and when told, and by how much
    their ranges and positions then differ, in standard deviations as claimed by default (median).
    """
    known = PARAMETERS[name][2](value)
    read = np.zeros(2)
    ranges, places = [], []
    for _ in range(markers):
        scene = known.scene(_scene(known, rng))
        # Who is not told takes the zones for the usual ones.
        recording = replace(Simulation(scene, rng).run(_SECONDS), grid=SENSOR.grid)
        usual, told = (_first(recording, one, scene.markers[0].id) for one in ({}, known.told))
        read += [usual is not None, told is not None]
        if usual is not None and told is not None:
            off_m = told.place.position_m - usual.place.position_m
            ranges.append(
                abs(told.place.range_m - usual.place.range_m) / usual.place.range_stddev_m
            )
            places.append(np.sqrt(off_m @ np.linalg.solve(usual.place.covariance[:3, :3], off_m)))
    median = [float(np.median(one)) if one else None for one in (ranges, places)]
    return {
        'value': value,
        'read by default': read[0] / markers,
        'read when told': read[1] / markers,
        'range': median[0],
        'position': median[1],
    }
