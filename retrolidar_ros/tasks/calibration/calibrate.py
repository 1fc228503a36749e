# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All that is found in a recording, put together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.blinking_zones import BlinkingZone, blinking_zones
from retrolidar_ros.detector.placement import modulated_depth
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.scene.marker_budget import NEEDED_SNR_DB, SENSOR_REACH_M, needed_swing
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, REFERENCE_AREA_M2
from retrolidar_ros.sensor.frame import Recording, valid_samples
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.tasks.calibration.crystal import Sent, fit_crystal
from retrolidar_ros.tasks.calibration.estimate import Estimate
from retrolidar_ros.tasks.calibration.noise import NoiseFound, noise_of
from retrolidar_ros.tasks.calibration.reading import read_markers
from retrolidar_ros.tasks.calibration.sweep import Sweep, sweep_of
from retrolidar_ros.tasks.calibration.timing import Timing, timing

_SAME_DEPTH_M, _MOVES_M = 0.1, 0.3
_FLIPPED = 0.2
_LEAST_ZONES = 3
_UNLIKE = 0.05  # of a marker's light, by which walls around it differ


@dataclass(frozen=True, eq=False)
class MarkerFound:
    """A marker that was read."""

    readings: list[Detection]
    sent: Sent
    range_m: Estimate | None
    """Radial, as measured: with the sensor's offset."""
    pedestal: Estimate | None
    """What its zone sees that is not it [kcps/SPAD]; None where no zone shows it."""
    contrast: Estimate | None
    """Share of its light that the dark crystal blocks; None where no zone shows it."""
    least_contrast: float
    """It blocks at least so much."""
    flipped: bool
    """Whether its dark bits show something else, so that the crystal's times are not known."""
    moves: bool


@dataclass(frozen=True)
class Link:
    """What follows from a distance that was measured otherwise."""

    marker: int
    distance_m: float
    offset_m: Estimate
    signal_at_1_m: Estimate
    """Of a bright 3 cm marker, if this one faces the sensor [kcps/SPAD]."""
    reach_m: float
    """To what distance 80 % of lone packets of 3 cm are to be expected."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """Everything that was found; None for what the recording does not show."""

    recording: Recording
    timing: Timing
    noise: NoiseFound | None
    zones: list[BlinkingZone]
    markers: list[MarkerFound]
    link: Link | None
    sweep: Sweep | None
    size_m: float

    @property
    def law(self) -> NoiseLaw:
        """The noise that was found, or the usual one."""
        return NoiseLaw() if self.noise is None else self.noise.law


def calibrate(
    recording: Recording,
    *,
    distance_m: float | None = None,
    size_m: float = MARKER_SIZE_M,
    speed_m_s: float | None = None,
) -> Calibration:
    """Return all that is found in a recording.

    Parameters
    ----------
    recording : Recording
    distance_m : float, optional
        From the sensor to the brightest marker, measured otherwise [m].
    size_m : float
        Edge of the markers [m].
    speed_m_s : float, optional
        How fast a marker was moved, straight across the view [m/s].

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

    def fitted(law: NoiseLaw) -> dict[int, Sent]:
        others = {one: set().union(*(seen[i] for i in seen if i != one)) for one in seen}
        return {
            one: fit_crystal(recording, read[one], law, others[one] - seen[one]) for one in read
        }

    sent = fitted(law)
    if sent and noise is not None:
        # What little of a marker is in zones at rest is taken off, and all is fitted again.
        waves = np.stack([one.light for one in sent.values()], axis=-1)
        noise = noise_of(recording, waves) or noise
        law = noise.law.lit(noise.light)
        sent = fitted(law)
    markers = [_marker(recording, own, sent[one], noise) for one, own in read.items()]
    markers.sort(key=lambda one: -one.sent.total)
    still = [one for one in markers if not one.moves]
    moving = next((one for one in markers if one.moves), None)
    return Calibration(
        recording=recording,
        timing=frames,
        noise=noise,
        zones=zones,
        markers=markers,
        link=_link(still[0], distance_m, size_m, law) if still and distance_m else None,
        sweep=sweep_of(recording, moving.sent, moving.readings, law, size_m, speed_m_s)
        if moving
        else None,
        size_m=size_m,
    )


def _marker(
    recording: Recording, readings: list[Detection], sent: Sent, noise: NoiseFound | None
) -> MarkerFound:
    """Return what is known of a marker that was read."""
    flipped = sent.flips > _FLIPPED
    gain, level = sent.gain, sent.level
    bright = gain.value + level.value
    pedestal = None if noise is None or flipped else _pedestal(recording, sent, noise)
    contrast = None
    if pedestal is not None and bright > pedestal.value:
        own = bright - pedestal.value
        blocked = gain.value / own
        contrast = Estimate(
            blocked,
            math.hypot(
                (1 - blocked) / own * gain.stddev,
                blocked / own * level.stddev,
                blocked / own * pedestal.stddev,
            ),
        )
    spread = np.array([one.place.range_m for one in readings])
    seen_by = {one.zones[0] for one in readings}
    return MarkerFound(
        readings=readings,
        sent=sent,
        range_m=_range(recording, sent),
        pedestal=pedestal,
        contrast=contrast,
        least_contrast=gain.value / bright if bright > 0 else 0.0,
        flipped=flipped,
        moves=len(seen_by) > 2 or float(np.ptp(spread)) > _MOVES_M,
    )


def _pedestal(recording: Recording, sent: Sent, noise: NoiseFound) -> Estimate | None:
    """Return what zones at rest see at a marker's distance; None if too few do."""
    with np.errstate(invalid='ignore'):
        depth = np.nanmedian(recording.distance[sent.light > 0.9, sent.zones[0]])
        near = [
            noise.signal(zone)
            for zone in noise.zones
            if abs(np.nanmedian(recording.distance[:, zone]) - depth) < _SAME_DEPTH_M
        ]
    if len(near) < _LEAST_ZONES or np.std(near) > _UNLIKE * sent.gain.value:
        return None
    return Estimate(float(np.median(near)), float(np.std(near, ddof=1)))


def _range(recording: Recording, sent: Sent) -> Estimate | None:
    """Return how far a marker is, from all samples of the zone that sees it best."""
    zone = sent.zones[0]
    known = np.isfinite(sent.light)
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    middle_s = (recording.stamp_ns[known] - recording.stamp_ns[0]) * 1e-9
    half_s = float(np.median(np.diff(middle_s))) / 2
    ranged = modulated_depth(
        middle_s - half_s,
        middle_s + half_s,
        sent.light[known],
        valid[known, zone],
        recording.signal[known, zone],
        recording.distance[known, zone],
    )
    factor = float(recording.grid.z_per_range[zone])
    return (
        None if ranged is None else Estimate(ranged.depth_m / factor, ranged.variance**0.5 / factor)
    )


def _link(marker: MarkerFound, distance_m: float, size_m: float, law: NoiseLaw) -> Link | None:
    """Return offset and signal of a marker at a known distance."""
    if marker.range_m is None:
        return None
    gain = marker.sent.gain
    contrast = marker.contrast or Estimate(1.0, 0.0)
    at_1_m = (
        marker.sent.total
        * distance_m**-DISTANCE_EXPONENT
        * REFERENCE_AREA_M2
        / size_m**2
        / contrast.value
    )
    error = math.hypot(gain.stddev / gain.value, contrast.stddev / contrast.value)
    wall = marker.pedestal.value if marker.pedestal else max(marker.sent.level.value, 0.0)
    swing = needed_swing(NEEDED_SNR_DB, law, wall) / contrast.value
    return Link(
        marker=marker.sent.id,
        distance_m=distance_m,
        offset_m=Estimate(marker.range_m.value - distance_m, marker.range_m.stddev),
        signal_at_1_m=Estimate(at_1_m, at_1_m * error),
        reach_m=min((swing / at_1_m) ** (1 / DISTANCE_EXPONENT), SENSOR_REACH_M),
    )
