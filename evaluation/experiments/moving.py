# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A marker that moves: how many of its packets are read, and how well it is placed."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.live import place_error
from evaluation.bench.rates import rate
from evaluation.bench.setup import Setup, arguments, setup_of, spread, told_rate
from retrolidar_ros.detector import Detection
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Sensor, Surface, Wander
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.reference import NOISE, RANGING, RESPONSE, WALL_SIGNAL
from retrolidar_ros.scene.truth import PACKET_S

RANGE_M = 1.0
WALL_M = 2.0
DURATION_S = 40.0
_BASE_M = 0.08  # the middle of the motion is at most so far from the axis, across and down
_CLOCK_ERROR = 0.003
BLUR = 0.05
"""With more of it the place within a zone is seen better."""


class Motion(NamedTuple):
    """How a marker moves: amplitudes [m] and period [s], as `Wander` has them."""

    name: str
    across_m: float
    along_m: float
    period_s: float


MOTIONS = (
    Motion('at rest', 0.0, 0.0, 3.0),
    Motion('across ±5 cm in 3 s', 0.05, 0.0, 3.0),
    Motion('across ±10 cm in 3 s', 0.10, 0.0, 3.0),
    Motion('across ±20 cm in 6 s', 0.20, 0.0, 6.0),
    Motion('across ±20 cm in 3 s', 0.20, 0.0, 3.0),
    Motion('across ±30 cm in 3 s', 0.30, 0.0, 3.0),
    Motion('along ±10 cm in 3 s', 0.0, 0.10, 3.0),
    Motion('along ±20 cm in 6 s', 0.0, 0.20, 6.0),
    Motion('both ±10 cm in 3 s', 0.10, 0.10, 3.0),
)


class Case(NamedTuple):
    """One run of a motion."""

    motion: Motion
    run: int
    setup: Setup
    blur: float


class Followed(NamedTuple):
    """What was read of one run."""

    read: int
    packets: int
    """Whole packets sent."""
    readings: int
    wrong: int
    range_m: list[float]
    """Errors at the stamps of the readings."""
    position_m: list[float]
    latencies_s: list[float]
    """From the end of a reading's last packet to its stamp; negative before it."""
    frames: int
    detector_s: float


def moving_scene(
    motion: Motion, rng: np.random.Generator, ids: Sequence[int], blur: float = BLUR
) -> Scene:
    """Return one marker that has always been sending, in front of a wall."""
    x, y = rng.uniform(-_BASE_M, _BASE_M, 2).tolist()
    marker = Marker(
        id=int(rng.choice(ids)),
        position_m=(x, y, RANGE_M),
        name='marker',
        clock_error=float(rng.uniform(-_CLOCK_ERROR, _CLOCK_ERROR)),
        start_s=float(rng.uniform(-PACKET_S, 0.0)),
        response=RESPONSE,
        wander=Wander(motion.across_m, motion.along_m, motion.period_s),
    )
    sensor = Sensor(noise=NOISE, ranging=RANGING, blur=blur)
    return Scene(sensor=sensor, markers=(marker,), surfaces=(Surface(WALL_M, WALL_SIGNAL),))


def intervals_read(detections: Sequence[Detection], marker: Marker) -> set[int]:
    """Return which packets of a marker were read: of several that were combined the last."""
    packet_s = PACKET_BITS * BIT_PERIOD_S * (1 + marker.clock_error)
    last_s = [
        1e-9 * detection.start_ns + (detection.packets - 0.5) * packet_s - marker.start_s
        for detection in detections
        if detection.id == marker.id
    ]
    return {math.floor(middle_s / packet_s) for middle_s in last_s}


def follow(case: Case) -> Followed:
    """Simulate one run and read it."""
    rng = case.setup.rng(MOTIONS.index(case.motion), case.run)
    scene = moving_scene(case.motion, rng, case.setup.ids.tolist(), case.blur)
    (marker,) = scene.markers
    recording = Simulation(scene, rng).run(DURATION_S)
    detector = case.setup.detector(recording.grid)
    began_s = time.process_time()
    detections = detector.update_all(recording)
    detector_s = time.process_time() - began_s
    packet_s = PACKET_BITS * BIT_PERIOD_S * (1 + marker.clock_error)
    # The first packet began before the first frame.
    packets = math.floor((DURATION_S - marker.start_s) / packet_s) - 1
    own = [detection for detection in detections if detection.id == marker.id]
    stamps_s = 1e-9 * np.array([detection.stamp_ns for detection in own], dtype=np.float64)
    truth_m = position_at(marker, stamps_s)
    errors = [place_error(detection.place, truth_m[index]) for index, detection in enumerate(own)]
    late_s = [1e-9 * (one.end_ns - one.start_ns) - one.packets * packet_s for one in own]
    return Followed(
        read=len(intervals_read(own, marker) & set(range(1, packets + 1))),
        packets=packets,
        readings=len(own),
        wrong=len(detections) - len(own),
        range_m=[error.range_m for error in errors],
        position_m=[error.position_m for error in errors],
        latencies_s=late_s,
        frames=len(recording),
        detector_s=detector_s,
    )


def _rms_mm(errors_m: Sequence[float]) -> float | None:
    return 1e3 * float(np.sqrt(np.mean(np.square(errors_m)))) if errors_m else None


def run(
    setup: Setup,
    *,
    runs: int,
    motions: Sequence[Motion] = MOTIONS,
    blur: float = BLUR,
    jobs: int = 1,
) -> dict[str, Any]:
    """Return shares of packets read and errors of place, by motion."""
    cases = [Case(motion, index, setup, blur) for motion in motions for index in range(runs)]
    found = dict(zip(cases, spread(follow, cases, jobs), strict=True))
    rows = []
    for motion in motions:
        followed = [found[Case(motion, index, setup, blur)] for index in range(runs)]
        latencies_s = [value for one in followed for value in one.latencies_s]
        rows.append(
            {
                'motion': motion.name,
                'read': rate(
                    sum(one.read for one in followed), sum(one.packets for one in followed)
                ),
                'readings': sum(one.readings for one in followed),
                'wrong': sum(one.wrong for one in followed),
                'range_mm': _rms_mm([value for one in followed for value in one.range_m]),
                'position_mm': _rms_mm([value for one in followed for value in one.position_m]),
                'stamp_after_end_s': float(np.median(latencies_s)) if latencies_s else None,
                'detector_us': 1e6
                * sum(one.detector_s for one in followed)
                / sum(one.frames for one in followed),
            }
        )
    return {'runs': runs, 'duration_s': DURATION_S, 'rows': rows}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""

    def told(value: float | None, digits: int = 1) -> str:
        return 'none' if value is None else f'{value:.{digits}f}'

    scene = f'a marker at {RANGE_M:g} m before a wall at {WALL_M:g} m'
    places = ''.join(f'{name:>10}' for name in ('range', 'position', 'stamp', 'µs/frame'))
    lines = [
        f'{scene}, {figures["runs"]} runs of {figures["duration_s"]:g} s',
        f'{"":24}{"packets read (95 %)":>24}{"readings/packets":>20}{"wrong":>8}{places}',
        f'{"":76}{"rms [mm]":>10}{"rms [mm]":>10}{"-end [s]":>10}',
    ]
    lines += [
        f'{row["motion"]:24}{told_rate(row["read"]):>24}'
        f'{row["readings"]:>12}/{row["read"]["trials"]:<7}{row["wrong"]:>8}'
        f'{told(row["range_mm"]):>10}{told(row["position_mm"]):>10}'
        f'{told(row["stamp_after_end_s"], 3):>10}{row["detector_us"]:>10.0f}'
        for row in figures['rows']
    ]
    return '\n'.join(lines)


def main() -> None:
    """Run the experiment and print its table."""
    parser = arguments(__doc__, runs=3)
    parser.add_argument('--only', metavar='TEXT', default='', help='motions named so')
    parser.add_argument('--blur', type=float, default=BLUR, help='of a zone (%(default)s)')
    told = parser.parse_args()
    motions = [motion for motion in MOTIONS if told.only in motion.name]
    figures = run(setup_of(told), runs=told.runs, motions=motions, blur=told.blur, jobs=told.jobs)
    print(summarise(figures))


if __name__ == '__main__':
    main()
