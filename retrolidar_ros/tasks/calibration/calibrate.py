# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from retrolidar_ros.detector.blinking_zones import BlinkingZone, blinking_zones
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.scene.marker_budget import NEEDED_SNR_DB, SENSOR_REACH_M, needed_swing
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, REFERENCE_AREA_M2
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.tasks.calibration.estimate import Estimate
from retrolidar_ros.tasks.calibration.markers import MarkerFound, marker_of, read_markers
from retrolidar_ros.tasks.calibration.noise import NoiseFound, noise_of
from retrolidar_ros.tasks.calibration.timing import Timing, timing


class Link(NamedTuple):
    """Results from a distance that was measured otherwise."""

    marker: int
    distance_m: float
    offset_m: Estimate
    signal_at_1_m: Estimate
    """Of a bright 3 cm marker over a dark one, if this one faces the sensor [kcps/SPAD]."""
    reach_m: float
    """Expected range at which 80 % of lone packets of 3 cm markers are read [m]."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """All results; None for what the recording does not show."""

    recording: Recording
    timing: Timing
    noise: NoiseFound | None
    zones: list[BlinkingZone]
    markers: list[MarkerFound]
    """Brightest first."""
    link: Link | None

    @property
    def law(self) -> NoiseLaw:
        """The noise that was found, or the usual one."""
        return NoiseLaw() if self.noise is None else self.noise.law


def calibrate(
    recording: Recording, *, distance_m: float | None = None, size_m: float = MARKER_SIZE_M
) -> Calibration:
    """Return all that is found in a recording.

    Parameters
    ----------
    recording : Recording
    distance_m : float, optional
        From the sensor to the brightest marker, measured otherwise [m].
    size_m : float
        Edge of the markers [m].

    Raises
    ------
    ValueError
        If there are too few frames, or their stamps do not rise.
    """
    frames = timing(recording)
    noise = noise_of(recording)
    law = NoiseLaw() if noise is None else noise.law.lit(noise.light)
    zones = blinking_zones(recording, law)
    read = read_markers(recording, zones, law, frames.period_s.value)
    seen = {one: {zone for reading in own for zone in reading.zones} for one, own in read.items()}
    markers = []
    for identity, own in read.items():
        others = set().union(*(seen[one] for one in seen if one != identity)) - seen[identity]
        markers.append(marker_of(recording, own, others))
    markers.sort(key=lambda one: -one.total)
    still = next((one for one in markers if not one.moves), None)
    link = _link(still, distance_m, size_m, law) if still and distance_m else None
    return Calibration(recording, frames, noise, zones, markers, link)


def _link(marker: MarkerFound, distance_m: float, size_m: float, law: NoiseLaw) -> Link:
    """Return offset and signal of a marker at a known distance."""
    scale = distance_m**-DISTANCE_EXPONENT * REFERENCE_AREA_M2 / size_m**2
    at_1_m = marker.total * scale
    swing = needed_swing(NEEDED_SNR_DB, law, max(marker.level, 0.0))
    return Link(
        marker=marker.id,
        distance_m=distance_m,
        offset_m=Estimate(marker.range_m.value - distance_m, marker.range_m.stddev),
        signal_at_1_m=Estimate(at_1_m, at_1_m * marker.gain.stddev / marker.gain.value),
        reach_m=min((swing / at_1_m) ** (1 / DISTANCE_EXPONENT), SENSOR_REACH_M),
    )
