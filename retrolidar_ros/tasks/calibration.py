# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The markers of a recording, without known bit periods, and all that it calibrates."""

import math
from collections import defaultdict
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector import METHODS, Detection, create_detector
from retrolidar_ros.detector.blinking_zones import MIN_FRAMES, BlinkingZone, blinking_zones
from retrolidar_ros.detector.explain import NOISELESS, noise_scale
from retrolidar_ros.detector.trials import Trial, best, candidates, every, trials
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Recording, frame_period
from retrolidar_ros.sensor.model import VL53L8CX, NoiseLaw
from retrolidar_ros.settings.parameter import declared
from retrolidar_ros.tasks.noise import Estimate, NoiseFound, noise_of, weighted_mean

_ZONES = 8
_MIN_PACKETS = 3
_UNSURE = 3e-3  # of a bit period, by a single packet
_SHARED_M = 2e-4  # error that all ranges of a marker at rest share
_MOVES_M = 0.3


class MarkerFound(NamedTuple):
    """A marker that was read."""

    id: int
    readings: list[Detection]
    zone: int  # that sees it best
    snr_db: float
    bit_period_s: Estimate
    range_m: Estimate  # radial, as measured: with the sensor's offset
    moves: bool


def read_markers(
    recording: Recording, zones: list[BlinkingZone], law: NoiseLaw, frame_s: float
) -> dict[int, list[Detection]]:
    """Return the readings of each marker, by its ID, with the bit period that reads most.

    Of the zones that blink, the strongest are first, and frames come every `frame_s` [s]. By a
    wrong bit period a wrong ID is read now and then; so a marker that was read but once of a packet
    that it is to repeat is left out.
    """

    def read(recording: Recording, bit_s: float) -> list[Detection]:
        sensor = replace(VL53L8CX, noise=law)
        detector = create_detector(METHODS[0], recording.grid, bit_period_s=bit_s, sensor=sensor)
        return detector.update_all(recording)

    clocks_s = [period.bit_period_s for zone in zones[:_ZONES] for period in zone.periods]
    likely_s = candidates(clocks_s, frame_s)
    done: list[Trial] = []
    for periods_s in (likely_s, every(frame_s)) if zones else ():
        for trial in trials(recording, periods_s, read, [one.tried_s for one in done]):
            done.append(trial)
            if trial.is_sure(recording):
                break
        if (found := best(done, recording, likely_s)) is not None:
            break
    else:
        return {}
    readings: defaultdict[int, list[Detection]] = defaultdict(list)
    for detection in found.detections:
        readings[detection.id].append(detection)
    duration_s = (recording.stamp_ns[-1] - recording.stamp_ns[0]) * 1e-9
    is_short = duration_s <= _MIN_PACKETS * PACKET_BITS * found.bit_period_s
    return {one: own for one, own in readings.items() if len(own) > 1 or is_short}


def marker_of(readings: list[Detection]) -> MarkerFound:
    """Return what is known of one marker from its readings."""
    periods_s = np.array([one.bit_period_s for one in readings])
    seen = [one.zones[0] for one in readings]
    places = [one.place for one in readings]
    ranges_m, stddev_m = np.array([(one.range_m, one.range_stddev_m) for one in places]).T
    range_m = weighted_mean(ranges_m, stddev_m)
    return MarkerFound(
        id=readings[0].id,
        readings=readings,
        zone=max(seen, key=seen.count),
        snr_db=float(np.median([one.snr_db for one in readings])),
        bit_period_s=weighted_mean(periods_s, _UNSURE * periods_s),
        range_m=Estimate(range_m.value, math.hypot(range_m.stddev, _SHARED_M)),
        moves=len(set(seen)) > 2 or float(np.ptp(ranges_m)) > _MOVES_M,
    )


@dataclass(frozen=True, eq=False)
class Calibration:
    """All results; None for what the recording does not show."""

    duration_s: float  # of the recording
    noise: NoiseFound | None
    is_noiseless: bool  # as of a scene without noise
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
    law = NoiseLaw().lit(recording.ambient) if noise is None else noise.law.lit(noise.light)
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
    is_noiseless = noise_scale(recording, law) < NOISELESS
    return Calibration(duration_s, noise, is_noiseless, zones, markers, still, offset_m)
