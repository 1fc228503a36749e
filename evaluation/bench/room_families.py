# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rooms of one kind each: `python -m evaluation.bench.room_families crossing --seed 5`.

All but what they are named after is that of the reference scene.
"""

import argparse
import math
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.recordings import signal_at
from evaluation.bench.room_markers import Course, RoomMarker, foreign_marker, own_marker
from evaluation.bench.room_scene import Room, RoomSimulation
from evaluation.bench.rooms import RoomResult, play_room
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import SIGNAL_AT_1_M, Surface
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats

SPEEDS_M_S = (0.05, 0.1, 0.2, 0.3, 0.4, 0.6)
PERIODS_MS = (15, 17, 19, 21, 23, 25, 28, 32, 36, 48, 54, 63, 75, 84, 100, 126, 150, 168)
SIGNALS = (20.0, 150.0, 600.0)  # [kcps/SPAD]
REGISTERED = (None, 16, 3)  # None = all IDs
RATIOS = (1.0, 0.7, 0.5, 0.35, 0.25)  # of the light of two markers
_PACKET_S = PACKET_BITS * BIT_PERIOD_S
_CLOCK_ERROR = 0.01
_BEHIND_M = 0.05  # how far behind the farthest marker the wall is
_APPEARS_S, _WATCHED_S = 3.0, 4.0
_TEN = 10


def _room(duration_s: float, *markers: RoomMarker) -> Room:
    depth_m = max(float(marker.course.place_m[2]) for marker in markers)
    wall = Surface(depth_m + _BEHIND_M, WALL_SIGNAL)
    scene = Scene(duration_s=duration_s, sensor=SENSOR, surfaces=(wall,))
    return Room(scene, BIT_PERIOD_S, markers)


def _bit_s(rng: np.random.Generator) -> float:
    return float(BIT_PERIOD_S * (1 + rng.uniform(-_CLOCK_ERROR, _CLOCK_ERROR)))


def _begun_s(rng: np.random.Generator) -> float:
    return float(-_PACKET_S * rng.random())


def _range_of(signal: float) -> float:
    """Return where a marker is so bright [m]."""
    return float((signal / SIGNAL_AT_1_M) ** (1 / DISTANCE_EXPONENT))


def _anywhere(zone: int, range_m: float, rng: np.random.Generator) -> Floats:
    """Return a place in a zone [m], a tenth of it or more from its border."""
    tangents = SENSOR.grid.tangents[zone] + SENSOR.grid.pitch * rng.uniform(-0.4, 0.4, 2)
    ray: Floats = np.append(tangents, 1.0)
    return range_m * ray / np.linalg.norm(ray)


def crossing(speed_m_s: float, duration_s: float, rng: np.random.Generator) -> Room:
    """Return one marker that goes through the view at 1 m, and repeats."""
    half_m = SENSOR.grid.view / 2
    place_m = np.array([*rng.uniform(-0.85 * half_m, 0.85 * half_m, 2), 1.0])
    course = Course('crossing', place_m, speed_m_s=np.array([speed_m_s, 0.0]))
    marker = own_marker('repeating', course, _bit_s(rng), _begun_s(rng), duration_s, rng)
    return _room(duration_s, marker)


def other_period(period_s: float, duration_s: float, rng: np.random.Generator) -> Room:
    """Return one marker of another bit period that repeats its packet."""
    place_m = _anywhere(int(rng.integers(SENSOR.grid.zones)), rng.uniform(0.5, 2.0), rng)
    begin_s = -PACKET_BITS * period_s * rng.random()
    course = Course('still', place_m)
    return _room(duration_s, foreign_marker('period', course, period_s, begin_s, duration_s, rng))


def ten_packets(signal: float, rng: np.random.Generator) -> Room:
    """Return a marker in each zone that sends ten random packets, and is silent before and after.

    This is the paper's trial (§6.1).
    """
    lasting_s = (_TEN - 1.5) * _PACKET_S  # `own_marker` sends one and a half more
    duration_s = (_TEN + 5) * _PACKET_S
    markers = []
    for direction in SENSOR.grid.directions:
        course = Course('still', _range_of(signal) * direction)
        begin_s = _PACKET_S * (1.5 + rng.random())
        bit_s = _bit_s(rng)
        markers.append(own_marker('sequence', course, bit_s, begin_s, begin_s + lasting_s, rng))
    return _room(duration_s, *markers)


def appearing(signal: float, rng: np.random.Generator) -> Room:
    """Return one marker that repeats, and appears in mid-packet."""
    zone = int(rng.integers(SENSOR.grid.zones))
    course = Course('still', _anywhere(zone, _range_of(signal), rng))
    until_s = _APPEARS_S + _WATCHED_S
    present_s = (_APPEARS_S, math.inf)
    begin_s = _begun_s(rng)
    marker = own_marker(
        'repeating', course, _bit_s(rng), begin_s, until_s, rng, present_s=present_s
    )
    return _room(until_s, marker)


def pair(ratio: float, sendings: tuple[str, str], rng: np.random.Generator) -> Room:
    """Return two markers in a zone, one of which has a share of the other's light."""
    zone, signal = int(rng.integers(SENSOR.grid.zones)), signal_at(1.3)
    duration_s = 12 * _PACKET_S
    markers = []
    for sending, share in zip(sendings, (1.0, ratio), strict=True):
        course = Course('still', _anywhere(zone, _range_of(share * signal), rng))
        markers.append(own_marker(sending, course, _bit_s(rng), _begun_s(rng), duration_s, rng))
    return _room(duration_s, *markers)


def _total(results: Sequence[RoomResult]) -> dict[str, Any]:
    """Return packets read and sent, wrong IDs, and the time."""
    whole = [
        was_read
        for result in results
        for packet, was_read in zip(result.scored.sent, result.scored.read, strict=True)
        if packet.whole
    ]
    return {
        'packets': len(whole),
        'read': round(sum(whole) / len(whole), 4) if whole else None,
        'wrong': sum(len(result.scored.wrong) for result in results),
        'hours': round(sum(result.duration_s for result in results) / 3600, 3),
    }


def first_id_s(room: Room, registered: int | None, rng: np.random.Generator) -> tuple[float, int]:
    """Return when the first right ID comes after the marker appears [s], and how many are wrong.

    The time is that of the frame with which it comes, infinite if none does.
    """
    recording = RoomSimulation(room, rng).run(room.scene.duration_s)
    own = int(room.markers[0].ids[0])
    ids = None
    if registered:
        others = rng.choice(USABLE_IDS[own != USABLE_IDS], registered - 1, replace=False)
        ids = np.append(others, own)
    detector = create_detector('joint', recording.grid, registered_ids=ids)
    first_s, wrong = math.inf, 0
    for frame in recording:
        for one in detector.update(frame):
            if one.id == own:
                first_s = min(first_s, frame.stamp_ns * 1e-9 - _APPEARS_S)
            else:
                wrong += 1
    return first_s, wrong


class Family(NamedTuple):
    """Figures of a family of rooms, row by row."""

    title: str
    rows: Callable[[int, float], Iterator[dict[str, Any]]]
    """By the seed, and how many times the usual number of rooms."""


def _rng(seed: int, *place: int) -> np.random.Generator:
    return np.random.default_rng([seed, *place])


def _crossing_rows(seed: int, times: float) -> Iterator[dict[str, Any]]:
    for index, speed in enumerate(SPEEDS_M_S):
        count = max(1, round(15 * times))
        rngs = [_rng(seed, 1, index, number) for number in range(count)]
        results = [play_room(0, crossing(speed, 20.0, rng), rng) for rng in rngs]
        yield {'speed_m_s': speed, **_total(results)}


def _period_rows(seed: int, times: float) -> Iterator[dict[str, Any]]:
    for index, period_ms in enumerate(PERIODS_MS):
        count = max(1, round(10 * times))
        rngs = [_rng(seed, 2, index, number) for number in range(count)]
        results = [play_room(0, other_period(1e-3 * period_ms, 20.0, rng), rng) for rng in rngs]
        total = _total(results)
        yield {'period_ms': period_ms, 'wrong': total['wrong'], 'hours': total['hours']}


def _ten_rows(seed: int, times: float) -> Iterator[dict[str, Any]]:
    for index, signal in enumerate(SIGNALS):
        count = max(1, round(2 * times))
        rngs = [_rng(seed, 3, index, number) for number in range(count)]
        results = [play_room(0, ten_packets(signal, rng), rng) for rng in rngs]
        yield {'signal': signal, **_total(results)}


def _appearing_rows(seed: int, times: float) -> Iterator[dict[str, Any]]:
    for registered in REGISTERED:
        for index, signal in enumerate(SIGNALS):
            count = max(1, round(48 * times))
            rngs = [_rng(seed, 4, index, number) for number in range(count)]
            found = [first_id_s(appearing(signal, rng), registered, rng) for rng in rngs]
            half, most = np.quantile([time_s for time_s, _ in found], (0.5, 0.9), method='higher')
            yield {
                'registered': registered or 'all',
                'signal': signal,
                'half_s': round(float(half), 2),
                'nine_tenths_s': round(float(most), 2),
                'wrong': sum(wrong for _, wrong in found),
            }


def _pair_rows(seed: int, times: float) -> Iterator[dict[str, Any]]:
    kinds = [('repeating', 'repeating'), ('repeating', 'sequence'), ('sequence', 'sequence')]
    for index, (sendings, ratio) in enumerate((kind, ratio) for kind in kinds for ratio in RATIOS):
        count = max(1, round(12 * times))
        rngs = [_rng(seed, 5, index, number) for number in range(count)]
        results = [play_room(0, pair(ratio, sendings, rng), rng) for rng in rngs]
        row = {'brighter': sendings[0], 'fainter': sendings[1], 'ratio': ratio, **_total(results)}
        for marker, name in enumerate(('brighter_read', 'fainter_read')):
            read = [
                was_read
                for result in results
                for packet, was_read in zip(result.scored.sent, result.scored.read, strict=True)
                if packet.whole and packet.marker == marker
            ]
            row[name] = round(sum(read) / len(read), 3)
        yield row


FAMILIES = {
    'crossing': Family('one marker crosses the view at 1 m', _crossing_rows),
    'periods': Family('one marker of another bit period', _period_rows),
    'ten': Family('ten random packets in each zone', _ten_rows),
    'appearing': Family('a marker appears in mid-packet: the first right ID', _appearing_rows),
    'pairs': Family('two markers in one zone', _pair_rows),
}


def main(arguments: list[str] | None = None) -> int:
    """Play families of rooms and print what became of them."""
    parser = argparse.ArgumentParser(prog='room_families', description=__doc__)
    parser.add_argument(
        'names', nargs='*', metavar='NAME', help=f'of {", ".join(FAMILIES)} (default: all)'
    )
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument('--times', type=float, default=1.0, help='of the usual number of rooms')
    options = parser.parse_args(arguments)
    for name in options.names or FAMILIES:
        print(f'{name}: {FAMILIES[name].title}')
        rows = list(FAMILIES[name].rows(options.seed, options.times))
        for row in rows:
            print('  ' + ', '.join(f'{key} {value}' for key, value in row.items()))
        if 'hours' in rows[0]:
            wrong, hours = (sum(row[key] for row in rows) for key in ('wrong', 'hours'))
            print(f'  in all {wrong} wrong in {hours:.2f} h: {wrong / hours:.1f} an hour')
    return 0


if __name__ == '__main__':
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.exit(main())
