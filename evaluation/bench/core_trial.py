# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the imported core reads, scene by scene, and its processor time for a frame."""

import math
from collections.abc import Callable, Iterable
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench import room_families as families
from evaluation.bench.changed_core import lines_of_core
from evaluation.bench.disturbances import FAMILY, Member
from evaluation.bench.judging import judged
from evaluation.bench.places import ELLIPSOID
from evaluation.bench.recordings import record
from evaluation.bench.room_scene import Room
from evaluation.bench.rooms import RoomResult, play, play_room
from evaluation.bench.stresses import PLAIN
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.sensor.frame import ZoneGrid

MIN_DB = 6.0  # of the packets that are counted: fainter ones are hardly read by any core
# Without a marker, parts differ sooner where there are many false IDs [1/h].
LAX: dict[str, Any] = {'false_ids_per_hour': 1e5}
# In rooms there are some ten times as many wrong IDs so, and hardly more are read.
LAX_OF_ROOMS = {'false_ids_per_hour': 10.0}
_ROOMS, _PAIRS, _CROSSING, _APPEARING, _FAINT, _STRETCHES = 200, 6, 3, 8, 4, 4
_SENDINGS = [('repeating', 'repeating'), ('repeating', 'sequence'), ('sequence', 'sequence')]
_RATIOS = (1.0, 0.7, 0.5, 0.35, 0.25)  # of the light of two markers in a zone
_SPEEDS_M_S = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6)
_REGISTERED, _SIGNALS = (None, 16, 3), (150.0, 600.0)  # None: all IDs; [kcps/SPAD]
_LONE_SIGNAL, _REPEATED_SIGNAL = 6.0, 2.5  # near the end of the reach [kcps/SPAD]
_REPEATED_PACKETS = 8
_STRETCH_S = 8.0
_DISTURBANCES = ('walk 0.3', 'come and go', 'hands', 'random levels', 'other bit periods')
FAR_OFF_M = 0.1  # an error of range that counts as no larger
_WATCHED_S = 8.0  # longest time to a first ID that is counted


class Outcome(NamedTuple):
    """The result of a scene."""

    found: float
    """Packets that were read; times to a first ID [s] and errors of places are negative."""
    of: float  # packets to be read, or the time that was watched
    wrong: int  # IDs


def _outcome(result: RoomResult) -> Outcome:
    whole = [
        was_read
        for packet, was_read in zip(result.scored.sent, result.scored.read, strict=True)
        if packet.whole and packet.snr_db > MIN_DB
    ]
    return Outcome(sum(whole), len(whole), len(result.scored.wrong))


def _placed(result: RoomResult) -> dict[str, Outcome]:
    """Return mean errors of places, and the share beyond their ellipsoids, all negative."""
    placed = result.scored.placed
    errors = {
        'range': [min(abs(one.error.range_m), FAR_OFF_M) for one in placed],
        'bearing': [max(map(abs, one.bearing_zones)) for one in placed],
        'ellipsoid': [float(one.error.squared_distance > ELLIPSOID) for one in placed],
    }
    return {name: Outcome(-float(np.mean(off or 0.0)), 1, 0) for name, off in errors.items()}


def _room(make: Callable[[np.random.Generator], Room], rng: np.random.Generator) -> RoomResult:
    return play_room(0, make(rng), rng, **LAX_OF_ROOMS)


def _appearing(kind: tuple[int | None, float], rng: np.random.Generator) -> Outcome:
    registered, signal = kind
    first_s, wrong = families.first_id_s(families.appearing(signal, rng), registered, rng)
    return Outcome(-min(first_s, _WATCHED_S), _WATCHED_S, wrong)


def _faint(lone: bool, rng: np.random.Generator) -> list[Outcome]:
    signal = _LONE_SIGNAL if lone else _REPEATED_SIGNAL
    sent = record(PLAIN, signal, rng, repeated_s=None if lone else _REPEATED_PACKETS * PACKET_S)
    one = judged(sent, {'method': 'joint'}, lone=lone)
    # Markers in different zones are independent.
    return [Outcome(int(right), 1, int(wrong)) for right, wrong in zip(*one[:2], strict=True)]


def _silent(member: Member, rng: np.random.Generator) -> Outcome:
    budget = {} if member.blinks else LAX
    (block,) = member.blocks(_STRETCH_S, rng)
    return Outcome(0, 0, len(create_detector('joint', ZoneGrid(), **budget).update_all(block)))


def measure(seed: int, times: float) -> dict[str, Any]:
    """Return outcomes by family, `times` the usual number of scenes, and lines of the core."""

    def scenes(first: int, count: int, members: Iterable[Any], run: Callable[..., Any]) -> Any:
        """Run scenes of each member of a family, each from a generator that every core gets.

        Where there is less than one scene for a member, some members have none.
        """
        share = count * times
        return [
            run(member, np.random.default_rng([seed, first + index, number]))
            for index, member in enumerate(members)
            for number in range(math.ceil((index + 1) * share) - math.ceil(index * share))
        ]

    silent = [one for one in FAMILY if one.name in _DISTURBANCES]
    two = [
        partial(families.pair, ratio, kind, woken=index % 2 == 1)
        for index, (kind, ratio) in enumerate(product(_SENDINGS, _RATIOS))
    ]
    speeds = [partial(families.crossing, speed, 20.0) for speed in _SPEEDS_M_S]
    played = [play(number, seed, **LAX_OF_ROOMS) for number in range(math.ceil(_ROOMS * times))]
    pairs = scenes(10, _PAIRS, two, _room)
    places = [_placed(result) for result in (*played, *pairs)]
    kinds, faint = product(_REGISTERED, _SIGNALS), scenes(2, _FAINT, (True, False), _faint)
    return {
        'rooms': [_outcome(result) for result in played],
        'pairs': [_outcome(result) for result in pairs],
        'crossing': [_outcome(result) for result in scenes(30, _CROSSING, speeds, _room)],
        'appearing': scenes(40, _APPEARING, kinds, _appearing),
        'faint': [outcome for sixteen in faint for outcome in sixteen],
        **{name: [room[name] for room in places] for name in places[0]},
        'no marker': scenes(60, _STRETCHES, silent, _silent),
        'lines': lines_of_core(),
    }


def frame_times_us(seed: int, rooms: int) -> list[float]:
    """Return the processor time of a frame in each of some random rooms [us]."""
    played = [play(number, seed) for number in range(rooms)]
    return [1e6 * one.cpu_s / one.frames for one in played]
