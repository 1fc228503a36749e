# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a detector reads of a recording, compared with what was sent."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.rates import Rate, rate
from evaluation.bench.recordings import Sent
from retrolidar_ros.detector import METHODS, Detection, Detector, create_detector
from retrolidar_ros.detector.detection import Track
from retrolidar_ros.sensor.frame import Frame, Recording

Options = Mapping[str, Any]  # of `create_detector`; 'method' among them
BOTH: dict[str, Options] = {method: {'method': method} for method in METHODS}
"""Both methods as shipped."""


def read_by_both(recording: Recording) -> dict[str, list[Detection]]:
    """Return what both methods read of a recording, as shipped."""
    return {
        method: create_detector(method, recording.grid).update_all(recording) for method in METHODS
    }


class Step(NamedTuple):
    """A frame, and what came with it."""

    known_s: float  # since the first frame
    frame: Frame
    detections: list[Detection]
    tracks: list[Track]  # of a detector that is asked to follow


def watch(detector: Detector, recording: Recording, *, follow: bool = False) -> Iterator[Step]:
    """Give frames to a detector one by one, and yield what comes with each."""
    for frame in recording:
        found = detector.update(frame)
        tracks = detector.follow(frame) if follow else []
        yield Step(1e-9 * (frame.stamp_ns - int(recording.stamp_ns[0])), frame, found, tracks)


class Judged(NamedTuple):
    """The result of a recording."""

    right: NDArray[np.bool_]  # whether the ID of each marker was read where it is, shape (markers,)
    wrong: NDArray[np.bool_]  # whether an ID that nothing sent was read there, shape (markers,)
    readings: int
    own: list[Detection]  # right readings
    candidates: int


def judged(sent: Sent, options: Options, *, lone: bool = True) -> Judged:
    """Play a recording to a new detector and compare what it reads with what was sent.

    Lone packets must be read at the right time, too.
    """
    detector = create_detector(grid=sent.recording.grid, **options)
    detections = detector.update_all(sent.recording)
    right, wrong = np.zeros((2, len(sent.ids)), dtype=bool)
    own: list[Detection] = []
    for detection in detections:
        # A marker that moves through all zones is in every zone.
        places = [zone % len(sent.ids) for zone in detection.zones]
        mine = [place for place in places if sent.ids[place] == detection.id]
        if mine:
            off_s = abs(detection.start_ns * 1e-9 - sent.start_s[mine[0]])
            # A reading half a packet or more away is not of this packet.
            if not lone or off_s < sent.packet_s / 2:
                right[mine[0]] = True
                own.append(detection)
        elif sent.seconds is None or detection.id not in sent.seconds[places]:
            wrong[places[0]] = True
    return Judged(right, wrong, len(detections), own, detector.counts.candidates)


def judge_all(
    make: Callable[[np.random.Generator], Sent],
    recordings: int,
    rng: np.random.Generator,
    variants: Mapping[str, Options] = BOTH,
    *,
    lone: bool = True,
) -> dict[str, list[Judged]]:
    """Play the same recordings to all variants of the detector, by their names."""
    sent = [make(rng) for _ in range(recordings)]
    return {
        name: [judged(one, options, lone=lone) for one in sent]
        for name, options in variants.items()
    }


def read_of(rows: Sequence[Judged]) -> dict[str, Rate]:
    """Return of how many markers the `right` ID was read, and of how many a `wrong` one."""
    names = ('right', 'wrong')
    found = {name: np.concatenate([getattr(row, name) for row in rows]) for name in names}
    return {name: rate(int(of.sum()), len(of)) for name, of in found.items()}
