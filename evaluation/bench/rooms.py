# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rooms that are read by a detector. A random one is drawn by a seed and its number.

Figures are from seeds whose rooms have not been used to improve the detector.
"""

import time
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.room_scene import Room, RoomSimulation, draw_room
from evaluation.bench.room_truth import Scored, packets_of, score
from retrolidar_ros.detector import create_detector


class RoomResult(NamedTuple):
    """The result of a room."""

    room: int  # its number
    frames: int
    cpu_s: float  # of the detector
    scored: Scored


def play_room(number: int, room: Room, rng: np.random.Generator, **options: Any) -> RoomResult:
    """Read a room by a new detector, with options of `create_detector`."""
    simulation = RoomSimulation(room, rng)
    recording = simulation.run(room.scene.duration_s)
    detector = create_detector('joint', recording.grid, bit_period_s=room.bit_period_s, **options)
    began_s = time.process_time()
    detections = detector.update_all(recording)
    cpu_s = time.process_time() - began_s
    scored = score(simulation, packets_of(simulation), detections)
    return RoomResult(number, len(recording), cpu_s, scored)


def play(number: int, seed: int, **options: Any) -> RoomResult:
    """Draw a room of a seed, and read it."""
    rng = np.random.default_rng([seed, number])
    return play_room(number, draw_room(rng), rng, **options)
