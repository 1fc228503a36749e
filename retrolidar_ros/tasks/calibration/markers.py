# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers of a recording, without known bit periods: their clocks and signals."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector import METHODS, Detection, create_detector
from retrolidar_ros.detector.blinking_zones import BlinkingZone
from retrolidar_ros.detector.trials import candidates, every, trials
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.scene.transmission import Transmission, exposure_edges
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.sensor.model import VL53L8CX
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.tasks.calibration.estimate import Estimate, weighted_mean

_ZONES = 8
_ALIKE = 0.04  # periods that are of one clock
_AS_SURE = 0.1
_MIN_PACKETS = 3
_EXPLAINED = 0.4  # of the recording, that a zone's marker is read in
_SEEN = 0.02  # of the strongest zone's gain, that a zone counts as one that sees the marker
# Bits by which packets of one train may be off, from one to the next and from all.
_SAME_TRAIN, _SAME_PACKETS = 0.45, 0.3
_UNSURE = 3e-3  # of a bit period, by a single packet
_START_ERROR, _USUAL = 0.02, 3  # usual error of a packet's start in bits, and its weight
_SHARED_M = 2e-4  # error that all ranges of a marker at rest share
_MOVES_M = 0.3


class MarkerFound(NamedTuple):
    """A marker that was read."""

    id: int
    readings: list[Detection]
    zone: int
    """That sees it best."""
    bit_period_s: Estimate
    light: Floats
    """Its mean transmission in each exposure, 0 to 1, NaN where it is not known; (frames,)."""
    level: float
    """Signal of the zone while it is dark [kcps/SPAD]."""
    gain: Estimate
    """By how much a bright one exceeds it [kcps/SPAD]."""
    total: float
    """The same, of all zones that see it together [kcps/SPAD]."""
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


def marker_of(
    recording: Recording, readings: list[Detection], others: AbstractSet[int]
) -> MarkerFound:
    """Return what is known of one marker from its readings, and the signals while it sent.

    Zones of `others` are left out.
    """
    origin_ns = int(recording.stamp_ns[0])
    period_s, start_s, packets = train_of(readings, origin_ns)
    time_s = (recording.stamp_ns - origin_ns) * 1e-9
    exposure_s = float(np.median(np.diff(time_s)))
    sent = Transmission(packet(readings[0].id), period_s.value, start_s, RESPONSE)
    end_s = start_s + packets * PACKET_BITS * period_s.value
    rows = (time_s > start_s + exposure_s) & (time_s < end_s - exposure_s)
    light = np.where(rows, sent.mean(exposure_edges(time_s, exposure_s)), np.nan)
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    valid[:, list(others)] = False
    signal = np.where(valid, recording.signal, 0.0).astype(np.float64)[rows]
    use = valid[rows]
    count = np.maximum(use.sum(axis=0), 1)
    shape = light[rows]
    change = (shape[:, None] - shape @ use / count) * use
    energy = np.maximum((change * change).sum(axis=0), 1e-9)
    gains = (change * signal).sum(axis=0) / energy
    zone = int(gains.argmax())
    level = float((signal[:, zone].sum() - gains[zone] * (shape @ use[:, zone])) / count[zone])
    left = (signal[:, zone] - level - gains[zone] * shape) * use[:, zone]
    deviation = float(np.sqrt(left @ left / count[zone] / energy[zone]))
    places = [one.place for one in readings]
    ranges_m, stddev_m = np.array([(one.range_m, one.range_stddev_m) for one in places]).T
    range_m = weighted_mean(ranges_m, stddev_m)
    return MarkerFound(
        id=readings[0].id,
        readings=readings,
        zone=zone,
        bit_period_s=period_s,
        light=light,
        level=level,
        gain=Estimate(float(gains[zone]), deviation),
        total=float(gains[gains > _SEEN * gains[zone]].sum()),
        range_m=Estimate(range_m.value, math.hypot(range_m.stddev, _SHARED_M)),
        moves=len({one.zones[0] for one in readings}) > 2 or float(np.ptp(ranges_m)) > _MOVES_M,
    )


def train_of(readings: Sequence[Detection], origin_ns: int) -> tuple[Estimate, float, int]:
    """Return bit period [s], start of the first packet [s] and packets of a marker's readings.

    A repeating marker's packets begin a whole number of packets apart; where they do not, only
    those since the last pause are used, or before it, whichever are more.
    """
    start_s = np.sort([(one.start_ns - origin_ns) * 1e-9 for one in readings])
    bit_s = float(np.median([one.bit_period_s for one in readings]))
    packet_s = PACKET_BITS * bit_s
    trains: list[list[tuple[int, float]]] = []
    for start in start_s.tolist():
        if trains:
            number, last = trains[-1][-1]
            packets = round((start - last) / packet_s)
            if abs(start - last - packets * packet_s) < _SAME_TRAIN * bit_s * max(packets, 1):
                trains[-1].append((number + packets, start))
                continue
        trains.append([(0, start)])
    number, begin = np.array(max(trains, key=len)).T
    packets = int(number[-1]) + 1
    if packets == 1:
        return Estimate(bit_s, _UNSURE * bit_s), float(begin[0]), 1
    near = np.abs(begin - np.polyval(np.polyfit(number, begin, 1), number)) < _SAME_PACKETS * bit_s
    if np.ptp(number[near]) > 0:
        number, begin = number[near], begin[near]
    slope, first_s = np.polyfit(number, begin, 1)
    left, spread = begin - first_s - slope * number, number - number.mean()
    # Of few packets the usual error says more than their own.
    error2 = float(left @ left) + _USUAL * (_START_ERROR * bit_s) ** 2
    stddev = math.sqrt(error2 / (max(len(number) - 2, 0) + _USUAL) / float(spread @ spread))
    return Estimate(float(slope), stddev).times(1 / PACKET_BITS), float(first_s), packets
