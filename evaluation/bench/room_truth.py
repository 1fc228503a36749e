# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was sent in a random room, and how it was read.

A reading is right if a marker near its direction sent its ID during half a packet of it, or half of
what it sent of that packet. A packet was read if right readings cover half of it. What a
foreign marker is read as is wrong, whatever it is.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from evaluation.bench.places import PlaceError, place_error
from evaluation.bench.room_markers import RoomMarker
from evaluation.bench.room_scene import Room, RoomSimulation
from retrolidar_ros.detector import Detection
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.scene.reference import NOISE
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.model import VL53L8CX

COMPANY = ('alone', 'beside', 'shared')
"""No other sends nearby; one does in a zone next to it; one does in its best zone."""
SIGNALS = ('faint', 'middling', 'bright')
BRIGHT_DB = (6.0, 14.0)
"""c over sigma from which a packet is middling, and bright: 6 dB above what one can be read at."""
NEAR_ZONES = 1.5
_SHARES = 0.1  # of a marker's light in its best zone: another with so much shares it
_HIDDEN = 0.2  # share of a packet that a hand may hide; of others no reading is expected
_TAIL_BITS = 48  # no reading is expected of a packet that ends later before the last frame
_NO_LIGHT = 1e-6
_WATCHED = 100  # times at which places of marker and reading are compared


class SentPacket(NamedTuple):
    """A packet that was sent in a room."""

    marker: int
    id: int
    start_s: float
    end_s: float
    sending: str
    motion: str
    company: str
    snr_db: float  # in its best zone
    zone: int
    whole: bool  # and so to be read

    @property
    def signal(self) -> str:
        """How bright it is, one of `SIGNALS`."""
        return SIGNALS[sum(self.snr_db >= bound for bound in BRIGHT_DB)]


class WrongReading(NamedTuple):
    """A reading of an ID that no marker nearby sent at that time."""

    time_s: float
    id: int
    true_ids: tuple[int, ...]  # of what was sent nearby meanwhile
    packets: int
    evidence: float
    margin: float
    zones: tuple[int, ...]
    near: str  # how the nearest marker sends; '' if there is none
    motion: str
    company: str
    signal: str


class Placed(NamedTuple):
    """How far a right reading is from its marker, at the stamp of its place."""

    motion: str
    company: str
    bearing_zones: tuple[float, float]  # across and down, measured less true
    range_stddev_m: float  # as estimated
    error: PlaceError

    @property
    def range_deviations(self) -> float:
        """Measured less true range, in standard deviations."""
        return self.error.range_m / self.range_stddev_m


class Scored(NamedTuple):
    """The result of a room."""

    sent: list[SentPacket]
    read: list[bool]  # of each packet, whether it was read
    readings: list[tuple[float, bool]]  # margin of each reading [nats], and whether it is right
    wrong: list[WrongReading]
    placed: list[Placed]  # of right readings


def packets_of(simulation: RoomSimulation) -> list[SentPacket]:
    """Return what was sent in a room that was simulated."""
    room, middle_s = simulation.room, simulation.middle_s
    markers = room.markers
    lasting_s = room.scene.duration_s - _TAIL_BITS * room.bit_period_s
    amplitude, variance = _seen(simulation)
    tangents = [_tangents(marker.course.positions(middle_s), len(middle_s)) for marker in markers]
    sent = []
    for index, marker in enumerate(markers):
        for number, start_s in zip(marker.ids.tolist(), marker.start_s.tolist(), strict=True):
            end_s = start_s + PACKET_BITS * marker.bit_s
            begun_s, ended_s = np.clip((start_s, end_s), *marker.present_s).tolist()
            begun_s = max(begun_s, 0.0)
            during = (middle_s >= begun_s) & (middle_s <= ended_s)
            if not during.any():
                continue
            own = amplitude[index, during].mean(axis=0)
            snr = own / np.sqrt(variance[index, during].mean(axis=0))
            zone = int(snr.argmax())
            company = 0
            for other, its_marker in enumerate(markers):
                if other == index or not _sends(its_marker, begun_s, ended_s):
                    continue
                apart = np.abs(tangents[other][during] - tangents[index][during]).max(axis=1)
                if amplitude[other, during, zone].mean() >= _SHARES * own[zone]:
                    company = 2
                elif apart.min() < NEAR_ZONES * room.scene.sensor.grid.pitch:
                    company = max(company, 1)
            hidden = simulation.hidden[index, during, zone].mean()
            seen_whole = (begun_s, ended_s) == (start_s, end_s) and end_s <= lasting_s
            sent.append(
                SentPacket(
                    marker=index,
                    id=number,
                    start_s=begun_s,
                    end_s=ended_s,
                    sending=marker.sending,
                    motion=marker.course.motion,
                    company=COMPANY[company],
                    snr_db=20 * math.log10(max(float(snr[zone]), _NO_LIGHT)),
                    zone=zone,
                    whole=bool(seen_whole and hidden <= _HIDDEN),
                )
            )
    return sent


def score(
    simulation: RoomSimulation, sent: Sequence[SentPacket], detections: Sequence[Detection]
) -> Scored:
    """Compare what was read in a room with what was sent."""
    room = simulation.room
    markers, grid = room.markers, room.scene.sensor.grid
    spans: list[list[tuple[float, float]]] = [[] for _ in sent]
    readings: list[tuple[float, bool]] = []
    wrong: list[WrongReading] = []
    placed: list[Placed] = []
    for one in detections:
        last_s, lasting_s = 1e-9 * one.end_ns, one.packets * PACKET_BITS * one.bit_period_s
        start_s = 1e-9 * one.start_ns
        watched_s = np.linspace(max(start_s, 0.0), max(start_s + lasting_s, last_s), _WATCHED)
        x, y, z = one.place.position_m.tolist()
        apart = [
            np.abs(_tangents(marker.course.positions(watched_s), 1) - (x / z, y / z))
            .max(axis=1)
            .min()
            / grid.pitch
            for marker in markers
        ]
        nearby = [place for place, p in enumerate(sent) if apart[p.marker] <= NEAR_ZONES]
        own = [place for place in nearby if sent[place].id == one.id]
        # One that was joined in its middle may begin a packet before its samples.
        for begin_s in (start_s, last_s - lasting_s):
            span_s = (begin_s, begin_s + lasting_s)
            mine = [place for place in own if _overlap_s(sent[place], span_s) > 0]
            right = _was_sent([sent[place] for place in mine], span_s, lasting_s / one.packets)
            if right:
                break
        readings.append((one.decision_margin, right))
        if right:
            longest = sent[max(mine, key=lambda place: _overlap_s(sent[place], span_s))]
            placed.append(_placed(one, longest, room))
            for place in mine:
                spans[place].append(span_s)
            continue
        overlap_s = [_overlap_s(p, (start_s, start_s + lasting_s)) for p in sent]
        during = [place for place in nearby if overlap_s[place] > 0]
        nearest = int(np.argmin(apart))
        near = markers[nearest] if apart[nearest] <= NEAR_ZONES else None
        its = [place for place in during if sent[place].marker == nearest]
        best = sent[max(its, key=overlap_s.__getitem__)] if its else None
        wrong.append(
            WrongReading(
                time_s=round(start_s, 2),
                id=one.id,
                true_ids=tuple(dict.fromkeys(sent[place].id for place in during)),
                packets=one.packets,
                evidence=round(one.evidence, 1),
                margin=round(one.decision_margin, 1),
                zones=one.zones,
                near=near.sending if near else '',
                motion=near.course.motion if near else '',
                company=best.company if best else '',
                signal=best.signal if best else '',
            )
        )
    read = [_covered(p, spans[place]) for place, p in enumerate(sent)]
    return Scored(list(sent), read, readings, wrong, placed)


def _placed(one: Detection, packet: SentPacket, room: Room) -> Placed:
    """Compare the place of a right reading with its marker's."""
    stamp_s = np.array([1e-9 * one.stamp_ns])
    (truth_m,) = room.markers[packet.marker].course.positions(stamp_s)
    both_m = np.array([one.place.position_m, truth_m])
    measured, true = _tangents(both_m, 2) / room.scene.sensor.grid.pitch
    across, down = (measured - true).tolist()
    error = place_error(one.place, truth_m)
    return Placed(packet.motion, packet.company, (across, down), one.place.range_stddev_m, error)


def _overlap_s(packet: SentPacket, span_s: tuple[float, float]) -> float:
    return min(span_s[1], packet.end_s) - max(span_s[0], packet.start_s)


def _was_sent(packets: Sequence[SentPacket], span_s: tuple[float, float], packet_s: float) -> bool:
    """Return whether one marker sent half a packet, or half of its part of one, in a time."""
    halves = defaultdict[int, float](float)
    for one in packets:
        there_s = min(packet_s, one.end_s - one.start_s)
        halves[one.marker] += 2 * _overlap_s(one, span_s) / there_s
    return any(count >= 1 for count in halves.values())


def _tangents(position_m: Floats, count: int) -> Floats:
    """Return x/z and y/z of positions, shape (n, 2), of one that is still `count` times."""
    tangents: Floats = position_m[:, :2] / position_m[:, 2:]
    return np.repeat(tangents, count, axis=0) if len(tangents) == 1 else tangents


def _sends(marker: RoomMarker, begin_s: float, end_s: float) -> bool:
    """Return whether a marker, be it foreign, sends at a time."""
    begin_s, end_s = np.clip((begin_s, end_s), *marker.present_s).tolist()
    if not len(marker.ids):
        return begin_s < end_s
    starts_s = marker.start_s
    ends_s = starts_s + PACKET_BITS * marker.bit_s
    return bool((np.minimum(ends_s, end_s) > np.maximum(starts_s, begin_s)).any())


def _seen(simulation: RoomSimulation) -> tuple[Floats, Floats]:
    """Return the amplitude of markers in the signal, and the variance of its noise half-way.

    Both are of shape (markers, frames, zones). What the sensor separates from a marker and is
    brighter hides it; what is merged with it adds noise.
    """
    bright, depth = simulation.bright, simulation.depth_m
    everything = np.concatenate([bright, simulation.others])
    amplitude, variance = np.empty_like(bright), np.empty_like(bright)
    for index, own in enumerate(bright):
        level, hiding = own / 2, np.zeros_like(own)
        for other, light in enumerate(everything):
            if other == index or not light.any():
                continue
            apart = np.abs(depth[other] - depth[index]) >= VL53L8CX.separable_m
            hiding = np.maximum(hiding, np.where(apart, light, 0.0))
            level = level + np.where(apart, 0.0, light * (0.5 if other < len(bright) else 1.0))
        contrast = simulation.room.markers[index].contrast
        amplitude[index] = contrast * np.maximum(own - hiding, 0.0)
        variance[index] = NOISE.floor + NOISE.slope * level
    return amplitude, variance


def _covered(packet: SentPacket, spans: Sequence[tuple[float, float]]) -> bool:
    """Return whether spans of time cover half of a packet."""
    covered_s, until_s = 0.0, packet.start_s
    for begin_s, end_s in sorted(spans):
        begin_s, end_s = max(begin_s, until_s), min(end_s, packet.end_s)
        if end_s > begin_s:
            covered_s += end_s - begin_s
            until_s = end_s
    return covered_s >= (packet.end_s - packet.start_s) / 2
