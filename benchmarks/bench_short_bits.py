# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far markers are read whose bits last one frame, by phase, jitter and clock error.

embedded/run python benchmarks/bench_short_bits.py [TRIALS]

A phase of 0 is a bit that begins with an exposure; at 0.5 every exposure sees two bits, half of
each.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from retrolidar_ros.detector import create_detector
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Response, Sensor, Surface

FRAME_S = 0.021
DISTANCES_M = (1.0, 1.75, 2.25, 2.75)
CASES = (
    ('2 frames, any phase, 1 ms jitter', 2.0, None, 0.0, 0.001, 1),
    ('1 frame, any phase, 1 ms jitter', 1.0, None, 0.0, 0.001, 1),
    ('1 frame, phase 0.5', 1.0, 0.5, 0.0, 0.0, 1),
    ('1 frame, 0.3 % slow, 1 ms, in 3 packets', 1.0, None, 0.003, 0.001, 3),
)
"""Name, frames a bit, phase of the first bit, clock error, jitter [s], packets."""


def was_read(
    frames: float,
    phase: float,
    error: float,
    jitter_s: float,
    packets: int,
    distance_m: float,
    seed: int,
) -> bool:
    """Return whether a 3 cm marker in the middle of a zone is read by some packets."""
    bit_s = frames * FRAME_S
    sensor = Sensor(period_s=FRAME_S, jitter_s=jitter_s, noise=Noise(4.6, 0.22))
    x, y, z = (distance_m * sensor.grid.directions[10]).tolist()
    marker = Marker(
        id=int(np.random.default_rng(seed).integers(1, 4095)),
        position_m=(x, y, z),
        bit_period_s=bit_s,
        clock_error=error,
        start_s=(20 + phase) * FRAME_S,
        packets=packets,
        response=Response(0.0005, 0.0035),
    )
    scene = Scene(sensor=sensor, markers=(marker,), surfaces=(Surface(z + 0.02, 4.0),))
    recording = Simulation(replace(scene, seed=seed)).run(31 * packets * bit_s + 2.0)
    detector = create_detector('joint', recording.grid, bit_period_s=bit_s)
    return marker.id in {reading.id for reading in detector.update_all(recording)}


def main() -> None:
    """Print the share of packets that are read, by case and distance."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    print(f'{"3 cm read [%]":42}', *(f'{one:5g} m' for one in DISTANCES_M))
    for name, frames, phase, error, jitter_s, packets in CASES:
        shares = []
        for distance_m in DISTANCES_M:
            read = [
                was_read(frames, begin, error, jitter_s, packets, distance_m, seed)
                for seed in range(trials)
                for begin in [seed / trials if phase is None else phase]
            ]
            shares.append(100 * np.mean(read))
        print(f'{name:42}', *(f'{share:7.0f}' for share in shares), flush=True)


if __name__ == '__main__':
    main()
