# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a frame takes without some parts of the core, room by room, as one line of JSON [us].

python -m evaluation.bench.core_time PART SEED ROOMS
"""

import json
import sys

from evaluation.bench.core_parts import names_of, use_core_without


def measure(off: str, seed: int, rooms: int) -> list[float]:
    """Measure; once only in a process, as the core that is imported first stays."""
    use_core_without(names_of(off))
    from evaluation.bench.rooms import play

    played = [play(number, seed) for number in range(rooms)]
    return [1e6 * one.cpu_s / one.frames for one in played]


if __name__ == '__main__':
    print(json.dumps(measure(sys.argv[1], *map(int, sys.argv[2:]))))
