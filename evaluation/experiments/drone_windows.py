# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""In how many windows of two seconds the drone is read: a quick figure."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

from evaluation.bench.live import read_live
from evaluation.bench.rates import rate
from evaluation.bench.setup import Setup, arguments, setup_of, spread, told_rate
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.tasks.heartbeat import Heartbeat

WINDOWS_S = (2.0, 5.0)


class Case(NamedTuple):
    """One flight."""

    run: int
    duration_s: float
    setup: Setup


class Flown(NamedTuple):
    """What was read of one flight."""

    known_s: list[float]
    """When the readings came."""
    wrong: int


def fly(case: Case) -> Flown:
    """Simulate one flight and read it frame by frame."""
    rng = case.setup.rng(case.run)
    scene = load_scene('drone')
    (drone,) = scene.markers
    if drone.id not in case.setup.ids:
        drone = replace(drone, id=int(rng.choice(case.setup.ids)))
    recording = Simulation(replace(scene, markers=(drone,)), rng).run(case.duration_s)
    readings = list(read_live(case.setup.detector(recording.grid), recording))
    own = [reading for reading in readings if reading.detection.id == drone.id]
    return Flown([1e-9 * reading.known_ns for reading in own], len(readings) - len(own))


def run(setup: Setup, *, runs: int, duration_s: float, jobs: int = 1) -> dict[str, Any]:
    """Return the shares of windows with a reading, over all runs."""
    flights = spread(fly, [Case(index, duration_s, setup) for index in range(runs)], jobs)
    alive = {}
    for window_s in WINDOWS_S:
        heartbeats = [Heartbeat(window_s) for _ in flights]
        for heartbeat, flown in zip(heartbeats, flights, strict=True):
            heartbeat.advance(0.0)
            for known_s in flown.known_s:
                heartbeat.beat(known_s)
            heartbeat.advance(duration_s)
        alive[window_s] = rate(
            sum(one.windows_alive for one in heartbeats), sum(one.windows for one in heartbeats)
        )
    return {
        'runs': runs,
        'duration_s': duration_s,
        'alive': alive,
        'readings': sum(len(flown.known_s) for flown in flights),
        'wrong': sum(flown.wrong for flown in flights),
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return the figures as lines of text."""
    lines = [f'drone, {figures["runs"]} runs of {figures["duration_s"]:g} s']
    lines += [
        f'windows of {window_s:g} s with a reading (95 %): {told_rate(share)}'
        for window_s, share in figures['alive'].items()
    ]
    per_s = figures['readings'] / (figures['runs'] * figures['duration_s'])
    lines.append(f'{per_s:.2f} readings/s, {figures["wrong"]} wrong IDs')
    return '\n'.join(lines)


def main() -> None:
    """Run the experiment and print its figures."""
    parser = arguments(__doc__, runs=2)
    parser.add_argument('--duration', type=float, default=120.0, help='of a run [s]')
    told = parser.parse_args()
    print(summarise(run(setup_of(told), runs=told.runs, duration_s=told.duration, jobs=told.jobs)))


if __name__ == '__main__':
    main()
