# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is read without some parts of the core, scene by scene, as one line of JSON.

python -m evaluation.bench.core_trial PART SEED TIMES

PART is a name of `PARTS` or `SETS` of `evaluation.bench.core_parts`, '' for the whole core.
"""

import json
import sys
from collections.abc import Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.core_parts import lines_of_core, names_of, use_core_without

MIN_DB = 6.0  # of the packets that are counted: fainter ones are hardly read by any
LAX_BUDGET = 1e5  # false IDs at so lax a budget [1/h] tell parts apart sooner
_ROOMS, _PAIRS, _CROSSING, _APPEARING, _FAINT, _STRETCHES = 100, 3, 3, 8, 4, 4
_RATIOS = (1.0, 0.7, 0.5, 0.35, 0.25)  # of the light of two markers in a zone
_SPEEDS_M_S = (0.05, 0.1, 0.2, 0.3, 0.45, 0.6)
_LONE_SIGNAL, _REPEATED_SIGNAL = 6.0, 2.5  # near the end of the reach [kcps/SPAD]
_REPEATED_PACKETS = 8
_STRETCH_S = 8.0
_DISTURBANCES = ('walk 0.3', 'come and go', 'hands', 'random levels', 'other bit periods')
_WATCHED_S = 8.0  # when no ID has come for so long after a marker appeared, this is its time


class Outcome(NamedTuple):
    """What became of a scene."""

    found: float
    """Packets that were read; where a marker appears, the time to its first ID [s], negative."""
    of: float  # packets to be read, or the time that was watched
    wrong: int  # IDs
    cpu_s: float  # of the detector; 0 where it was not measured


def _played(result: Any) -> Outcome:
    whole = [
        was_read
        for packet, was_read in zip(result.scored.sent, result.scored.read, strict=True)
        if packet.whole and packet.snr_db > MIN_DB
    ]
    return Outcome(sum(whole), len(whole), len(result.scored.wrong), result.cpu_s)


def measure(off: str, seed: int, times: float) -> dict[str, Any]:
    """Return outcomes by family, and lines of the core without some of its parts.

    Once only in a process, as the core that is imported first stays.
    """
    use_core_without(names_of(off))
    from evaluation.bench import room_families as families
    from evaluation.bench.disturbances import FAMILY
    from evaluation.bench.judging import judged
    from evaluation.bench.recordings import record
    from evaluation.bench.rooms import play, play_room
    from evaluation.bench.stresses import PLAIN
    from retrolidar_ros.detector import create_detector
    from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
    from retrolidar_ros.sensor.frame import ZoneGrid

    def rngs(family: int, count: float) -> Iterator[np.random.Generator]:
        """Yield a generator for each scene of a family, the same whatever is off."""
        for number in range(max(1, round(count * times))):
            yield np.random.default_rng([seed, family, number])

    def pairs() -> Iterator[Outcome]:
        kinds = [('repeating', 'repeating'), ('repeating', 'sequence'), ('sequence', 'sequence')]
        for index, (sendings, ratio) in enumerate(product(kinds, _RATIOS)):
            for rng in rngs(10 + index, _PAIRS):
                yield _played(play_room(0, families.pair(ratio, sendings, rng), rng))

    def crossing() -> Iterator[Outcome]:
        for index, speed in enumerate(_SPEEDS_M_S):
            for rng in rngs(30 + index, _CROSSING):
                yield _played(play_room(0, families.crossing(speed, 20.0, rng), rng))

    def appearing() -> Iterator[Outcome]:
        kinds = product(families.REGISTERED, families.SIGNALS[1:])
        for index, (registered, signal) in enumerate(kinds):
            for rng in rngs(40 + index, _APPEARING):
                room = families.appearing(signal, rng)
                first_s, wrong = families.first_id_s(room, registered, rng)
                yield Outcome(-min(first_s, _WATCHED_S), _WATCHED_S, wrong, 0.0)

    def faint() -> Iterator[Outcome]:
        repeated_s = _REPEATED_PACKETS * PACKET_BITS * BIT_PERIOD_S
        for lone, rng in [*product([True], rngs(2, _FAINT)), *product([False], rngs(3, _FAINT))]:
            signal = _LONE_SIGNAL if lone else _REPEATED_SIGNAL
            sent = record(PLAIN, signal, rng, repeated_s=None if lone else repeated_s)
            one = judged(sent, {'method': 'joint'}, lone=lone)
            # Markers in zones of their own have nothing to do with each other.
            for right, wrong in zip(one.right, one.wrong, strict=True):
                yield Outcome(int(right), 1, int(wrong), 0.0)

    def disturbances() -> Iterator[Outcome]:
        members = [member for member in FAMILY if member.name in _DISTURBANCES]
        for index, member in enumerate(members):
            budget: dict[str, Any] = {} if member.blinks else {'false_ids_per_hour': LAX_BUDGET}
            for rng in rngs(60 + index, _STRETCHES):
                detector = create_detector('joint', ZoneGrid(), **budget)
                (block,) = member.blocks(_STRETCH_S, rng)
                yield Outcome(0, 0, len(detector.update_all(block)), 0.0)

    return {
        'rooms': [_played(play(number, seed)) for number in range(max(1, round(_ROOMS * times)))],
        'pairs': list(pairs()),
        'crossing': list(crossing()),
        'appearing': list(appearing()),
        'faint': list(faint()),
        'no marker': list(disturbances()),
        'lines': lines_of_core(),
    }


if __name__ == '__main__':
    off, seed, times = sys.argv[1:]
    print(json.dumps(measure(off, int(seed), float(times))))
