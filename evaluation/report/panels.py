# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The stresses of the experiment `stability`, each from harmless to what no reading survives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from evaluation.bench.link import RANGE_M, Trial, link_scene, lone_trial, packet_duration_s
from evaluation.bench.stress import drift, hide, light_of, lose_dark, sensed
from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Sensor, Surface
from retrolidar_ros.scene.marker_budget import SNR, needed_swing
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import ZoneGrid

SNR_DB = 14.0  # of all panels but those that sweep it
FAR_WALL_M = RANGE_M + 1.0
SLOW_SENSOR = replace(SENSOR, grid=ZoneGrid(8, 8), period_s=1 / 15)
SLOW_BIT_PERIOD_S = 2 / 15


@dataclass(frozen=True)
class Panel:
    """One stress and how it is swept."""

    name: str
    title: str
    axis: str
    """Of the values, with their unit."""
    values: tuple[float, ...]
    harmless: float
    """The value from which the breaking points are sought, on both sides."""
    trial: Callable[[float, np.random.Generator], Trial]
    """Makes the trials at a value."""
    grid: ZoneGrid = SENSOR.grid
    bit_period_s: float = BIT_PERIOD_S
    """What the detector believes [s]."""


def _usual(rng: np.random.Generator) -> Scene:
    return link_scene(SNR_DB, rng)


def _weak(snr_db: float, rng: np.random.Generator) -> Trial:
    return lone_trial(link_scene(snr_db, rng), rng)


def _weak_and_slow(snr_db: float, rng: np.random.Generator) -> Trial:
    scene = link_scene(snr_db, rng, sensor=SLOW_SENSOR, bit_period_s=SLOW_BIT_PERIOD_S)
    return lone_trial(scene, rng)


def _sensor(change: Callable[[Sensor, float], Sensor]) -> Callable[..., Trial]:
    """Return what makes trials with a sensor that a value changes."""

    def trial(value: float, rng: np.random.Generator) -> Trial:
        scene = _usual(rng)
        return lone_trial(replace(scene, sensor=change(scene.sensor, value)), rng)

    return trial


def _markers(**fields: Callable[[float], Any]) -> Callable[..., Trial]:
    """Return what makes trials with markers whose fields a value decides."""

    def trial(value: float, rng: np.random.Generator) -> Trial:
        scene = _usual(rng)
        changes = {name: of(value) for name, of in fields.items()}
        return lone_trial(
            replace(scene, markers=tuple(replace(marker, **changes) for marker in scene.markers)),
            rng,
        )

    return trial


def _vanishing_dark(percent: float, rng: np.random.Generator) -> Trial:
    scene = _usual(rng)
    light = light_of(scene, rng)
    recording = sensed(light, scene.sensor, rng)
    return Trial(scene, lose_dark(recording, light, percent / 100, rng))


def _drifting(percent: float, rng: np.random.Generator) -> Trial:
    scene = _usual(rng)
    light = drift(light_of(scene, rng), scene, percent / 100)
    return Trial(scene, sensed(light, scene.sensor, rng))


def _hidden(lasting_ms: float, rng: np.random.Generator) -> Trial:
    scene = _usual(rng)
    light = hide(light_of(scene, rng), scene, lasting_ms / 1000)
    return Trial(scene, sensed(light, scene.sensor, rng))


def _dominated(ratio: float, rng: np.random.Generator) -> Trial:
    """Put a wall too far behind the markers to merge with them."""
    scene = _usual(rng)
    wall = Surface(FAR_WALL_M, ratio * (WALL_SIGNAL + needed_swing(SNR_DB)))
    return lone_trial(replace(scene, surfaces=(*scene.surfaces, wall)), rng)


def _two_in_a_zone(percent: float, rng: np.random.Generator) -> Trial:
    """Put a second marker into every zone, its packet overlapping the first one's."""
    scene = _usual(rng)
    if percent == 0:
        return lone_trial(scene, rng)
    packet_s = packet_duration_s(scene)
    other_ids = rng.integers(1, IDS - 2, len(scene.markers))
    second = tuple(
        replace(
            marker,
            id=1 + (marker.id - 1 + int(other)) % (IDS - 2),
            size_m=marker.size_m * float(np.sqrt(percent / 100)),
            start_s=marker.start_s + rng.uniform(-packet_s, packet_s),
        )
        for marker, other in zip(scene.markers, other_ids, strict=True)
    )
    return lone_trial(replace(scene, markers=scene.markers + second), rng)


_SNRS_DB = (20.0, 17.0, 14.0, 12.0, 10.0, 8.0, 6.0, 2.0, -2.0)

PANELS = (
    Panel('snr', 'weak signal', f'{SNR} [dB]', _SNRS_DB, 20.0, _weak),
    Panel(
        'lost_frames',
        'lost frames',
        'frames lost [%]',
        (0, 5, 10, 15, 20, 30, 40, 50, 60),
        0,
        _sensor(lambda sensor, percent: replace(sensor, lost=percent / 100)),
    ),
    Panel(
        'jitter',
        'jitter of exposures, stamps true',
        'standard deviation [ms]',
        (0, 0.5, 1, 1.5, 2, 2.5, 3, 4, 5),
        0,
        _sensor(lambda sensor, ms: replace(sensor, jitter_s=ms / 1000)),
    ),
    Panel(
        'clock_skew',
        "skew of the marker's clock",
        'bits longer by [%]',
        (-3, -2, -1, -0.5, 0, 0.5, 1, 2, 3),
        0,
        _markers(clock_error=lambda percent: percent / 100),
    ),
    Panel(
        'abnormal',
        'abnormal samples, garbage values',
        'samples abnormal [%]',
        (0, 5, 10, 20, 30, 40, 50, 65, 80),
        0,
        _sensor(lambda sensor, percent: replace(sensor, abnormal=percent / 100)),
    ),
    Panel(
        'no_target',
        'dark reported as "no target"',
        'dark samples without target [%]',
        (0, 10, 25, 40, 50, 60, 75, 90, 100),
        0,
        _vanishing_dark,
    ),
    Panel(
        'drift',
        "drift of the marker's light",
        'change over the packet [%]',
        (-100, -75, -50, -25, 0, 25, 50, 75, 100),
        0,
        _drifting,
    ),
    Panel(
        'hand',
        'a hand in mid-packet',
        'hidden for [ms]',
        (0, 21, 42, 84, 126, 210, 300, 450, 600),
        0,
        _hidden,
    ),
    Panel(
        'far_wall',
        'a wall 1 m behind, told apart',
        "wall / marker's bright signal",
        (0, 0.2, 0.4, 0.6, 0.8, 0.9, 1, 1.5, 2),
        0,
        _dominated,
    ),
    Panel(
        'two_markers',
        'two markers in one zone',
        "second marker's signal [%]",
        (0, 10, 20, 30, 40, 50, 70, 85, 100),
        0,
        _two_in_a_zone,
    ),
    Panel(
        'bit_period',
        'bit period, 42 ms believed',
        "marker's bit period [ms]",
        (38, 40, 41, 41.5, 42, 42.5, 43, 44, 46),
        42,
        _markers(bit_period_s=lambda ms: ms / 1000),
    ),
    Panel(
        'slow_8x8',
        '8×8 zones, 15 Hz, bits of 133 ms',
        f'{SNR} [dB]',
        _SNRS_DB,
        20.0,
        _weak_and_slow,
        SLOW_SENSOR.grid,
        SLOW_BIT_PERIOD_S,
    ),
)
