# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is read without some parts of the core, as one line of JSON.

python -m evaluation.bench.core_trial PART SEED ROOMS RECORDINGS HANDS_SECONDS
"""

import json
import sys
from typing import NamedTuple

import numpy as np

from evaluation.bench.core_parts import lines_of_core, names_of, use_core_without

FAINT_SIGNAL = 8.0  # [kcps/SPAD]
HANDS_BUDGET = 1000.0  # false IDs at so lax a budget [1/h] tell parts apart sooner
MIN_DB = 6.0  # of the packets that are counted: fainter ones are hardly read by any


class Without(NamedTuple):
    """What is read without some parts of the core."""

    packets: int  # of random rooms
    read: int
    readings: int
    wrong: int
    faint: int  # lone packets read near the end of the reach
    false: int  # IDs before moving hands
    frame_us: float
    lines: int  # of the core


def measure(off: str, seed: int, rooms: int, recordings: int, hands_s: float) -> Without:
    """Measure; once only in a process, as the core that is imported first stays."""
    use_core_without(names_of(off))
    from evaluation.bench.disturbances import FAMILY
    from evaluation.bench.judging import judged
    from evaluation.bench.recordings import record
    from evaluation.bench.rooms import play_all
    from evaluation.bench.stresses import PLAIN
    from retrolidar_ros.detector import create_detector
    from retrolidar_ros.sensor.frame import ZoneGrid

    results = play_all(range(rooms), seed)
    scored = [one.scored for one in results]
    read = [
        was_read
        for one in scored
        for packet, was_read in zip(one.sent, one.read, strict=True)
        if packet.whole and packet.snr_db > MIN_DB
    ]
    rng = np.random.default_rng([seed, 1])
    options = {'method': 'joint'}
    faint = [judged(record(PLAIN, FAINT_SIGNAL, rng), options) for _ in range(recordings)]
    detector = create_detector('joint', ZoneGrid(), false_ids_per_hour=HANDS_BUDGET)
    hands = next(member for member in FAMILY if 'hands' in member.name)
    false = sum(len(detector.update_all(block)) for block in hands.blocks(hands_s, rng))
    return Without(
        packets=len(read),
        read=sum(read),
        readings=sum(len(one.readings) for one in scored),
        wrong=sum(len(one.wrong) for one in scored),
        faint=int(sum(one.right.sum() for one in faint)),
        false=false,
        frame_us=1e6 * sum(one.cpu_s for one in results) / sum(one.frames for one in results),
        lines=lines_of_core(),
    )


if __name__ == '__main__':
    off, seed, rooms, recordings, hands_s = sys.argv[1:]
    row = measure(off, int(seed), int(rooms), int(recordings), float(hands_s))
    print(json.dumps(row._asdict()))
