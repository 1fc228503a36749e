# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers of random rooms: how they move, and what they send, of ours or foreign."""

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.recordings import SILENCE_BITS, log_uniform, to_and_fro
from retrolidar_ros.marker.code import PACKET_BITS, PREAMBLE, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.description import Response
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.scene.transmission import transmitted
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

SENDINGS = ('repeating', 'lone', 'pauses', 'sequence')
"""Without end; one packet now and then; with short pauses; a new ID in each packet."""
FOREIGN = ('period', 'clock', 'bits', 'preamble')
"""Another bit period; random bits of any length; random bits; another preamble."""
MOTIONS = ('still', 'swaying', 'crossing')
INNER = 0.95
"""Markers that cross the view turn round at this share of its half."""
_FOREIGN_BITS = (0.5, 1.5)  # lengths of bits without a clock
_FOREIGN_PERIODS, _OWN_PERIODS = (0.25, 4.0), (0.9, 1.1)  # over ours
_FOREIGN_DISTANCE = 4  # bits to the nearest packet, begun with any bit


@dataclass(frozen=True)
class Course:
    """How a marker moves: about a place, or evenly through the view and back."""

    motion: str
    place_m: Floats  # its middle, or where it begins, shape (3,)
    swing_m: Floats = field(default_factory=lambda: np.zeros(3))  # along x, y and z
    turn_s: Floats = field(default_factory=lambda: np.ones(3))  # periods of these [s]
    fade: float = 0.0  # by what share its light rises and falls as it turns
    speed_m_s: Floats = field(default_factory=lambda: np.zeros(2))  # along x and y
    half: float = ZoneGrid().view / 2  # of the view, as a tangent

    def positions(self, time_s: Floats) -> Floats:
        """Return positions [m] at times, shape (n, 3), or (1, 3) of one that is still."""
        if self.motion == 'still':
            return self.place_m[None]
        turn = 2 * math.pi * time_s[:, None] / self.turn_s
        position: Floats = self.place_m + self.swing_m * np.sin(turn + np.arange(3))
        if self.motion == 'crossing':
            half_m = INNER * self.half * self.place_m[2]
            along = half_m + self.place_m[:2] + self.speed_m_s * time_s[:, None]
            position[:, :2] = to_and_fro(along, half_m)
        return position

    def brightness(self, time_s: Floats) -> Floats:
        """Return the factor of its light at times, shape (n,)."""
        turned: Floats = 1 + self.fade * np.sin(2 * math.pi * time_s / self.turn_s[0])
        return turned


@dataclass(frozen=True)
class RoomMarker:
    """What a marker sends, where and when."""

    sending: str
    course: Course
    bit_s: float  # of the true clock
    ids: NDArray[np.int64]  # of its packets, shape (n,); none of a foreign one
    start_s: Floats  # of its packets, shape (n,)
    edges_s: Floats  # where its bits begin, ascending; shape (bits,)
    levels: Floats  # 1 = bright, from there on, shape (bits,)
    response: Response = RESPONSE
    contrast: float = 1.0
    present_s: tuple[float, float] = (-math.inf, math.inf)  # before and after it is not there

    def transmission(self, edges_s: Floats) -> Floats:
        """Return what share of the light it lets through between edges (n, 2) [s], shape (n,)."""
        share = transmitted(self.edges_s, self.levels, self.response, edges_s)
        there = np.clip(edges_s, *self.present_s)
        visible = (there[:, 1] - there[:, 0]) / (edges_s[:, 1] - edges_s[:, 0])
        return visible * (1 - self.contrast * (1 - share))


def room_marker(
    sending: str,
    course: Course,
    bit_s: float,
    begin_s: float,
    until_s: float,
    rng: np.random.Generator,
    **rest: Any,
) -> RoomMarker:
    """Return a marker that sends from one time on, until another or later [s].

    Ours has random IDs, a foreign one none.
    """
    if sending in FOREIGN:
        none: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        edges = foreign_edges(sending, bit_s, begin_s, until_s, rng)
        return RoomMarker(sending, course, bit_s, none, np.zeros(0), *edges, **rest)
    count = 2 + int((until_s - begin_s) / (PACKET_BITS * bit_s))
    pauses: NDArray[np.int64] = np.zeros(count, dtype=np.int64)
    if sending == 'lone':
        pauses = rng.integers(SILENCE_BITS, 4 * SILENCE_BITS, count)
    elif sending == 'pauses':
        pauses = rng.integers(1, PACKET_BITS, count)
    drawn = rng.choice(USABLE_IDS, count)
    ids = drawn if sending == 'sequence' else np.repeat(drawn[:1], count)
    start_s = begin_s + bit_s * np.concatenate([[0], np.cumsum(PACKET_BITS + pauses)[:-1]])
    # It stays bright after a packet, if there is a pause.
    levels = np.concatenate([1.0 - packet(ids), np.ones((count, 1))], axis=1)
    edges_s = start_s[:, None] + bit_s * np.arange(PACKET_BITS + 1)
    kept = np.ones(levels.shape, dtype=bool)
    kept[:-1, -1] = pauses[:-1] > 0
    return RoomMarker(sending, course, bit_s, ids, start_s, edges_s[kept], levels[kept], **rest)


def foreign_ratio(rng: np.random.Generator) -> float:
    """Return a bit period of a foreign marker, over ours."""
    while True:
        ratio = float(log_uniform(_FOREIGN_PERIODS, rng))
        if not _OWN_PERIODS[0] <= ratio <= _OWN_PERIODS[1]:
            return ratio


def foreign_edges(
    sending: str, bit_s: float, begin_s: float, until_s: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return where the bits of a foreign marker begin [s], and 1 of bright ones, shape (bits,)."""
    count = 2 + int((until_s - begin_s) / (bit_s * _FOREIGN_BITS[0]))
    if sending in ('bits', 'clock'):
        bits = rng.integers(0, 2, count, dtype=np.uint8)
    else:
        sent = _foreign_packet(rng) if sending == 'preamble' else packet(rng.choice(USABLE_IDS))
        bits = np.resize(sent, count)
    lengths_s = np.full(count, bit_s)
    if sending == 'clock':
        lengths_s *= rng.uniform(*_FOREIGN_BITS, count)
    return begin_s + np.concatenate([[0.0], np.cumsum(lengths_s)[:-1]]), 1.0 - bits


def _foreign_packet(rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return another preamble with a word, far from every packet that is begun with any bit."""
    signs = 1 - 2 * packet(USABLE_IDS).astype(float)
    while True:
        preamble = rng.integers(0, 2, len(PREAMBLE), dtype=np.uint8)
        bits = np.concatenate([preamble, packet(rng.choice(USABLE_IDS))[len(PREAMBLE) :]])
        turned = np.array([np.roll(bits, turn) for turn in range(PACKET_BITS)])
        if ((1 - 2.0 * turned) @ signs.T).max() <= PACKET_BITS - 2 * _FOREIGN_DISTANCE:
            return bits
