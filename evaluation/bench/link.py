# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Links of a wanted strength: a marker in every zone, each zone a trial of its own.

The strength of a link is c over sigma: the signal of the bright marker less that of the dark
one, over the standard deviation of the noise at the mean of both, as 20 log10 in decibels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector import Detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.scene.marker_budget import needed_swing
from retrolidar_ros.scene.optics import received_signal
from retrolidar_ros.scene.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.sensor.frame import Recording

RANGE_M = 1.0
SILENCE_BITS = 60  # before a marker wakes: 2.5 s
_WAKING_BITS = 12  # it wakes at a random time within as many
_TAIL_BITS = 12  # after the last packet


def marker_size(signal: float) -> float:
    """Return the edge [m] of a marker at `RANGE_M` that is as bright as a signal [kcps/SPAD]."""
    return math.sqrt(signal / float(received_signal(np.array(RANGE_M), 1.0, 0.0)))


def link_scene(
    snr_db: float,
    rng: np.random.Generator,
    *,
    packets: int | None = 1,
    sensor: Sensor = SENSOR,
    bit_period_s: float = BIT_PERIOD_S,
) -> Scene:
    """Return a scene of markers with a wanted link, one in the middle of every zone.

    Parameters
    ----------
    snr_db : float
        c over sigma [dB].
    rng : numpy.random.Generator
        Where IDs and starts come from.
    packets : int or None
        How many packets each marker sends after a silence; None = it has always been sending,
        at a random phase.
    sensor : Sensor
        What sees them; its noise is that of the reference scene.
    bit_period_s : float
        How long they hold a bit [s].
    """
    first_bit = (
        (-PACKET_BITS, 0) if packets is None else (SILENCE_BITS, SILENCE_BITS + _WAKING_BITS)
    )
    return marker_in_each_zone(
        RANGE_M,
        rng,
        start_s=(first_bit[0] * bit_period_s, first_bit[1] * bit_period_s),
        packets=packets,
        size_m=marker_size(needed_swing(snr_db)),
        sensor=sensor,
        bit_period_s=bit_period_s,
    )


def packet_duration_s(scene: Scene) -> float:
    """Return how long a marker of the scene sends one packet [s]."""
    marker = scene.markers[0]
    return PACKET_BITS * marker.bit_period_s * (1 + marker.clock_error)


def lone_duration_s(scene: Scene) -> float:
    """Return the time [s] after which all lone packets of a scene have ended for a while."""
    last_start_s = max(marker.start_s for marker in scene.markers)
    return last_start_s + packet_duration_s(scene) + _TAIL_BITS * scene.markers[0].bit_period_s


class Trial(NamedTuple):
    """Frames, and the scene that they are of."""

    scene: Scene
    recording: Recording


def lone_trial(scene: Scene, rng: np.random.Generator) -> Trial:
    """Return a scene of lone packets with its frames."""
    return Trial(scene, Simulation(scene, rng).run(lone_duration_s(scene)))


class Reading(NamedTuple):
    """An ID that was read in a zone."""

    end_ns: int
    """Of the last frame that it needed [ns]."""
    zone: int
    right: bool
    """Whether a marker of the zone has this ID."""


def read(trial: Trial, detector: Detector) -> list[Reading]:
    """Play a recording to a detector and compare what it reads with the scene.

    The scene's markers are one a zone in the order of the zones, once or more often.
    """
    zones = trial.recording.grid.zones
    own: list[set[int]] = [set() for _ in range(zones)]
    for index, marker in enumerate(trial.scene.markers):
        own[index % zones].add(marker.id)
    return [
        Reading(detection.end_ns, detection.zones[0], detection.id in own[detection.zones[0]])
        for detection in detector.update_all(trial.recording)
    ]


class Outcome(NamedTuple):
    """What became of the trial in each zone; neither of both = nothing was read."""

    right: NDArray[np.bool_]
    """Whether the ID of a marker of the zone was read, shape (zones,)."""
    wrong: NDArray[np.bool_]
    """Whether another ID was read, shape (zones,)."""


def outcome(trial: Trial, detector: Detector) -> Outcome:
    """Play a recording to a detector and tell in which zones it read right and wrong IDs."""
    result = Outcome(*np.zeros((2, trial.recording.grid.zones), dtype=bool))
    for reading in read(trial, detector):
        (result.right if reading.right else result.wrong)[reading.zone] = True
    return result
