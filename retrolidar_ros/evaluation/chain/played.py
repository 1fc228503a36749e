# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One marker before a wall, played to the default detector until it is read, and what it had then.

The detector forgets what it has computed. So the stages are run once more, by the same functions
on the same samples, and `Played` holds what they need.
"""

from __future__ import annotations

from collections import Counter
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.code import BIT_PERIOD_S
from retrolidar_ros.detector import METHODS, Detection, create_detector
from retrolidar_ros.detector.candidates import Candidates
from retrolidar_ros.detector.evidence import NoiseLaw, correlation_threshold
from retrolidar_ros.detector.evidence_detector import EvidenceDetector
from retrolidar_ros.detector.judge import USUAL_FALSE_IDS_PER_HOUR, Judge, Reading
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.detector.search import PACKET_SAMPLES, Demand
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.window import Samples, placed
from retrolidar_ros.detector.words import WordBank
from retrolidar_ros.evaluation.live import read_live
from retrolidar_ros.evaluation.reference import RESPONSE
from retrolidar_ros.frame import Recording
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.yaml_files import load_scene

CLOCK_ERROR = 0.002
"""Of the marker: its bits last so much longer than they should."""


def marker_before_wall(
    identity: int,
    position_m: tuple[float, float, float],
    wall: Surface,
    *,
    start_s: float,
    packets: int | None,
) -> Scene:
    """Return a scene with the sensor of the coffee scene: jitter, clocks, blur and noise.

    Parameters
    ----------
    identity : int
        Of the only marker.
    position_m : (float, float, float)
        Where it is, in the optical frame [m].
    wall : Surface
        What stands behind it.
    start_s : float
        When it begins its first packet [s].
    packets : int or None
        How many it sends; None = without end.
    """
    marker = Marker(
        id=identity,
        position_m=position_m,
        name='marker',
        start_s=start_s,
        packets=packets,
        clock_error=CLOCK_ERROR,
        response=RESPONSE,
    )
    return Scene(sensor=load_scene('coffee').sensor, markers=(marker,), surfaces=(wall,))


class Played(NamedTuple):
    """A recording in which a marker was read, and the state of the detector at that moment."""

    scene: Scene
    recording: Recording
    frames: int
    """How many of them it took until the marker was read."""
    samples: Samples
    """Of these frames."""
    detection: Detection
    chance: dict[int, float]
    """What noise is granted with each hypothesis, as `EvidenceDetector.chance`."""
    noise_scale: float
    refused: dict[str, int]
    """How many candidates were refused before, by reason."""
    bank: WordBank

    @property
    def marker(self) -> Marker:
        """The only one of the scene."""
        return self.scene.markers[0]

    @property
    def zone(self) -> int:
        """Which sees the marker best."""
        return self.detection.zones[0]

    @property
    def truth_start_s(self) -> float:
        """When the marker began its first packet, in the time of the samples [s]."""
        return self.marker.start_s - float(self.recording.stamp_ns[0]) * 1e-9

    def view(self, samples: Samples | None = None) -> View:
        """Return what the zone saw: until the marker was read, or in the samples given."""
        return View.of(self.samples if samples is None else samples, np.array([self.zone]))

    def demand(self, view: View, packets: int = 0) -> Demand:
        """Return what noise must not reach; `packets` is 0 for one that has just ended."""
        threshold = correlation_threshold(PACKET_SAMPLES * max(1, packets), self.chance[packets])
        return Demand(threshold, self.noise_scale * NoiseLaw().variance(view.mean))

    def judged(self, candidates: Candidates) -> Reading:
        """Return what the judge makes of candidates in the zone.

        Raises
        ------
        ValueError
            If it refuses all of them.
        """
        grid = self.recording.grid
        judge = Judge(
            self.bank,
            grid,
            NoiseLaw(),
            max_packets=MAX_PACKETS,
            false_ids_per_hour=USUAL_FALSE_IDS_PER_HOUR,
        )
        everything = View.of(self.samples, np.arange(grid.zones))
        packets = int(candidates.packets[0]) if candidates.repeats[0] else 0
        rejected: Counter[str] = Counter()
        readings = judge.judge(
            candidates, everything, self.chance[packets], self.noise_scale, rejected
        )
        if not readings:
            raise ValueError(f'what was read is refused now: {dict(rejected)}')
        return readings[0]


def play(
    scene: Scene, rng: np.random.Generator, duration_s: float, least_packets: int = 1
) -> Played:
    """Play a scene to the default detector, frame by frame, until its marker is read.

    Parameters
    ----------
    scene : Scene
    rng : numpy.random.Generator
        Where the noise comes from.
    duration_s : float
        How long it may take [s].
    least_packets : int
        Readings from fewer packets do not count.

    Raises
    ------
    ValueError
        If it is not read in that time.
    """
    recording = Simulation(scene, rng).run(duration_s)
    detector = cast(EvidenceDetector, create_detector(METHODS[0], recording.grid))
    for known_ns, detection in read_live(detector, recording):
        if detection.packets < least_packets:
            continue
        frames = int(np.searchsorted(recording.stamp_ns, known_ns, side='right'))
        return Played(
            scene=scene,
            recording=recording,
            frames=frames,
            samples=placed(recording, frames, BIT_PERIOD_S),
            detection=detection,
            chance=detector.chance,
            noise_scale=detector.noise.value,
            refused=dict(detector.counts.rejected),
            bank=WordBank(),
        )
    raise ValueError(f'the marker is not read within {duration_s} s')


def only_zone(candidates: Candidates, zone: int) -> Candidates:
    """Return candidates of a view of one zone with the zone's own number."""
    zones: NDArray[np.intp] = np.full(len(candidates.zone), zone)
    return candidates._replace(zone=zones)


def rounded(values: ArrayLike, digits: int) -> list[float | None]:
    """Return numbers as JSON has them, to so many digits; null for what is not a number."""
    plain = np.round(np.asarray(values, dtype=float), digits)
    return [float(value) if np.isfinite(value) else None for value in plain]
