# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers of a recording, without known bit periods: their clocks and ranges."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector import METHODS, Detection, create_detector
from retrolidar_ros.detector.blinking_zones import BlinkingZone
from retrolidar_ros.detector.trials import candidates, every, trials
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.model import VL53L8CX
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.tasks.calibration.estimate import Estimate, weighted_mean

_ZONES = 8
_ALIKE = 0.04  # periods that are of one clock
_AS_SURE = 0.1
_MIN_PACKETS = 3
_EXPLAINED = 0.4  # of the recording, that a zone's marker is read in
_UNSURE = 3e-3  # of a bit period, by a single packet
_SHARED_M = 2e-4  # error that all ranges of a marker at rest share
_MOVES_M = 0.3


class MarkerFound(NamedTuple):
    """A marker that was read."""

    id: int
    readings: list[Detection]
    zone: int
    """That sees it best."""
    snr_db: float
    bit_period_s: Estimate
    range_m: Estimate
    """Radial, as measured: with the sensor's offset."""
    moves: bool


def read_markers(
    recording: Recording, zones: list[BlinkingZone], law: NoiseLaw, frame_s: float
) -> dict[int, list[Detection]]:
    """Return the readings of each marker, by its ID.

    A wrong period may let a wrong ID be read, again and again, and the faint light of a marker in
    the next zone, too. So beside the marker with the most evidence others are kept that have two
    of three: its period, zones of their own, and nearly as much evidence; and none that was read
    but once of a packet that it is to repeat.

    Parameters
    ----------
    recording : Recording
    zones : list of BlinkingZone
        Of the recording, strongest first.
    law : NoiseLaw
        Of the sensor.
    frame_s : float
        Frame period [s].
    """
    groups: list[list[Detection]] = []
    tried_s: list[float] = []
    duration_s = (recording.stamp_ns[-1] - recording.stamp_ns[0]) * 1e-9

    def read(recording: Recording, bit_s: float) -> list[Detection]:
        sensor = replace(VL53L8CX, noise=law)
        detector = create_detector(METHODS[0], recording.grid, bit_period_s=bit_s, sensor=sensor)
        return detector.update_all(recording)

    for rank in range(max((len(zone.periods) for zone in zones[:_ZONES]), default=0)):
        for zone in zones[:_ZONES]:
            if rank >= len(zone.periods) or zone.zone in _explained(groups, duration_s):
                continue
            likely_s = candidates([zone.periods[rank].bit_period_s], frame_s)
            for trial in trials(recording, likely_s, read, tried_s):
                tried_s.append(trial.tried_s)
                groups += _groups(trial.detections)
    if zones and not groups:
        for trial in trials(recording, every(frame_s), read, tried_s):
            groups += _groups(trial.detections)
            if trial.is_sure(recording):
                break
    kept: dict[int, list[Detection]] = {}
    for own in sorted(groups, key=lambda group: -_evidence(group)):
        if len(own) < 2 and duration_s > _MIN_PACKETS * PACKET_BITS * own[0].bit_period_s:
            continue
        if kept:
            most, *_ = kept.values()
            alike = abs(own[0].bit_period_s / most[0].bit_period_s - 1) < _ALIKE
            elsewhere = {one.zones[0] for one in own}.isdisjoint(
                one.zones[0] for others in kept.values() for one in others
            )
            sure = _evidence(own) > _AS_SURE * _evidence(most)
            if alike + elsewhere + sure < 2:
                continue
        kept.setdefault(own[0].id, own)
    return kept


def _evidence(group: list[Detection]) -> float:
    return sum(one.evidence for one in group)


def _groups(detections: list[Detection]) -> list[list[Detection]]:
    """Return readings as a list an ID."""
    found: defaultdict[int, list[Detection]] = defaultdict(list)
    for detection in detections:
        found[detection.id].append(detection)
    return list(found.values())


def _explained(groups: list[list[Detection]], duration_s: float) -> set[int]:
    """Return the zones whose blinking is that of a marker that was read most of the time."""
    explained: set[int] = set()
    for own in groups:
        read_s = sum(PACKET_BITS * one.bit_period_s for one in own)
        if read_s > _EXPLAINED * duration_s:
            explained.update(zone for one in own for zone in one.zones)
    return explained


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
