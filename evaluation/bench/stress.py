# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What can go wrong between a marker and the frames, where a scene has no word for it.

What happens to the light is done to a recording without noise, and the sensor's noise comes
after it, so that it belongs to the light that there is then.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from evaluation.bench.link import lone_duration_s, packet_duration_s
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.scene.noise import deviating, noisy
from retrolidar_ros.scene.reference import WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats, Recording, Status

HAND_SIGNAL = 1700.0  # a hand at this distance [kcps/SPAD]
HAND_DISTANCE_M = 0.2


def light_of(scene: Scene, rng: np.random.Generator, duration_s: float | None = None) -> Recording:
    """Return what a sensor without noise reports, by default until all lone packets are sent."""
    silent = replace(scene.sensor, noise=None, ranging=None)
    simulation = Simulation(replace(scene, sensor=silent), rng)
    return simulation.run(lone_duration_s(scene) if duration_s is None else duration_s)


def sensed(light: Recording, sensor: Sensor, rng: np.random.Generator) -> Recording:
    """Return a recording without noise as the sensor reports it."""
    clean = light.signal.astype(np.float64)
    signal = noisy(clean, sensor.noise, rng)
    distance = deviating(light.distance.astype(np.float64), clean, sensor.ranging, rng)
    return replace(light, signal=signal.astype(np.float32), distance=distance.astype(np.float32))


def _since_start(recording: Recording, scene: Scene) -> Floats:
    """Return the time from each zone's packet to each frame, in packets: (frames, zones)."""
    zones = recording.grid.zones
    starts_s = np.array([marker.start_s for marker in scene.markers[:zones]])
    since_s: Floats = recording.stamp_ns[:, None] * 1e-9 - starts_s
    return since_s / packet_duration_s(scene)


def drift(light: Recording, scene: Scene, gain: float) -> Recording:
    """Let the marker's light, not the wall's, grow linearly during its packet.

    It goes from 1 - gain/2 to 1 + gain/2 of what it was, and stays before and after; so its
    mean over the packet does not change. A negative gain lets it fade.
    """
    course = np.clip(_since_start(light, scene), 0.0, 1.0) - 0.5
    marker = light.signal - WALL_SIGNAL
    return replace(light, signal=(WALL_SIGNAL + marker * (1 + gain * course)).astype(np.float32))


def hide(light: Recording, scene: Scene, lasting_s: float) -> Recording:
    """Pass a hand before every marker, for a time [s] about the middle of its packet."""
    exposure_s = scene.sensor.period_s
    from_middle_s = (_since_start(light, scene) - 0.5) * packet_duration_s(scene)
    begin_s = np.maximum(from_middle_s - exposure_s / 2, -lasting_s / 2)
    end_s = np.minimum(from_middle_s + exposure_s / 2, lasting_s / 2)
    hidden = np.maximum(end_s - begin_s, 0.0) / exposure_s
    hand, rest = hidden * HAND_SIGNAL, (1 - hidden) * light.signal
    return replace(
        light,
        signal=(hand + rest).astype(np.float32),
        distance=np.where(hand > rest, np.float32(HAND_DISTANCE_M), light.distance),
    )


def appear(light: Recording, at_s: float) -> Recording:
    """Show the bare wall in the frames before a time [s]."""
    before = light.stamp_ns[:, None] < at_s * 1e9
    return replace(light, signal=np.where(before, np.float32(WALL_SIGNAL), light.signal))


def lose_dark(
    recording: Recording, light: Recording, share: float, rng: np.random.Generator
) -> Recording:
    """Report no target in a share of the samples in which the marker is dark.

    Parameters
    ----------
    recording, light : Recording
        The same frames with and without noise; `light` tells which samples are dark.
    share : float
        0 to 1.
    rng : numpy.random.Generator
        Chooses the samples.
    """
    middle = (light.signal.min(axis=0) + light.signal.max(axis=0)) / 2
    lost = (light.signal < middle) & (rng.random(light.signal.shape) < share)
    return replace(
        recording,
        signal=np.where(lost, np.float32(0.0), recording.signal),
        distance=np.where(lost, np.float32(np.nan), recording.distance),
        status=np.where(lost, np.uint8(Status.NO_TARGET), recording.status),
    )
