# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The result of a detector, and its counts."""

from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

from retrolidar_ros.detector.place import Place
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid


@dataclass(frozen=True, eq=False)
class Detection:
    """One marker, read once; the fields mirror `MarkerDetection.msg`."""

    id: int
    stamp_ns: int  # when the place holds: the mean time of the samples used for it [ns]
    start_ns: int  # when the (first) packet began [ns]: up to 8 bits after the first frame
    end_ns: int  # time of the last frame used [ns]
    place: Place
    snr_db: float  # 20 log10 of amplitude over a sample's deviation from the fitted packet [dB]
    evidence: float  # log likelihood ratio against no packet [nats]; NaN where a method has none
    decision_margin: float  # the same against the nearest other ID [nats]; NaN likewise
    bit_period_s: float  # how long the marker holds a bit, as measured [s]
    score: float  # normalised correlation of the samples with the sent packet, 0 to 1
    likelihood: float  # the paper's l at the start of the packet
    corrected_bits: int
    packets: int
    zones: tuple[int, ...]  # indices of the zones used, strongest first


@dataclass
class DetectorCounts:
    """Candidates by outcome so far."""

    candidates: int = 0  # packets found, one for every zone that saw one
    accepted: int = 0
    rejected: Counter[str] = field(default_factory=Counter)  # by reason
    impossible: int = 0  # samples with a valid status but an impossible signal or distance
    overloads: int = 0  # frames with too many candidates, of which the least likely were dropped


class Detector(Protocol):
    """Every method: frames in, detections out; ValueError for frames of another zone grid."""

    @property
    def counts(self) -> DetectorCounts:
        """Candidates by outcome so far."""

    def update(self, frame: Frame) -> list[Detection]:
        """Take the next frame; return the detections that became certain with it."""

    def update_all(self, recording: Recording) -> list[Detection]:
        """Take many frames; return the detections that became certain with them."""


def check_grid(grid: ZoneGrid, expected: ZoneGrid) -> None:
    """Raise ValueError if a frame has another zone grid than the detector that it came to."""
    if grid is not expected and grid != expected:
        raise ValueError(
            f'a frame of {grid.rows}x{grid.columns} zones came to a detector '
            f'for {expected.rows}x{expected.columns}'
        )
