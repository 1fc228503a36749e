# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The calibration of a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrolidar_ros.detector.blinking_zones import MIN_FRAMES, BlinkingZone, blinking_zones
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.frame_rate import frame_period
from retrolidar_ros.sensor.model import NoiseLaw
from retrolidar_ros.settings.parameter import declared
from retrolidar_ros.tasks.calibration.estimate import Estimate
from retrolidar_ros.tasks.calibration.markers import MarkerFound, marker_of, read_markers
from retrolidar_ros.tasks.calibration.noise import NoiseFound, noise_of


@dataclass(frozen=True, eq=False)
class Calibration:
    """All results; None for what the recording does not show."""

    duration_s: float  # of the recording
    noise: NoiseFound | None
    zones: list[BlinkingZone]  # those that blink
    markers: list[MarkerFound]  # clearest first
    still: MarkerFound | None  # the clearest marker at rest
    offset_m: Estimate | None  # by how much its range exceeds its distance


def calibrate(recording: Recording, *, distance_m: float | None = None) -> Calibration:
    """Return all that is found in a recording.

    `distance_m` is from the sensor to the clearest marker at rest, measured otherwise [m].
    ValueError if it is not the marker's, there are too few frames, or their stamps do not rise.
    """
    if len(recording) < MIN_FRAMES:
        raise ValueError(
            f'{len(recording)} frames are too few to calibrate from: record {MIN_FRAMES} at '
            'least, and half a minute for all there is'
        )
    if not (np.diff(recording.stamp_ns) > 0).all():
        raise ValueError('the stamps of the frames do not rise: was the clock set while recording?')
    noise = noise_of(recording)
    law = NoiseLaw() if noise is None else noise.law.lit(noise.light)
    zones = blinking_zones(recording, law)
    read = read_markers(recording, zones, law, frame_period(recording))
    markers = sorted(map(marker_of, read.values()), key=lambda one: -one.snr_db)
    still = next((one for one in markers if not one.moves), None)
    offset_m = None
    if distance_m is not None and still is not None:
        offset_m = Estimate(still.range_m.value - distance_m, still.range_m.stddev)
        try:
            declared()['detector']['range_offset'].check('range_offset', offset_m.value)
        except ValueError as error:
            raise ValueError(
                f'{distance_m:g} m is not the distance of the clearest marker: ID {still.id} is at '
                f'{still.range_m.value:.2f} m; {error}'
            ) from error
    duration_s = float(recording.stamp_ns[-1] - recording.stamp_ns[0]) * 1e-9
    return Calibration(duration_s, noise, zones, markers, still, offset_m)
