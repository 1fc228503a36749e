# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How tracks end if a marker is gone after some bits unseen, as one line of JSON.

python -m evaluation.bench.track_end_trial GONE_BITS SEED TRIALS SECONDS GAP [GAP...]
"""

import json
import sys
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.core_parts import Part, use_core_with

USED_BITS = 8.5  # by the core
RANGES_M = (1.0, 2.0)
_LINE = 'GONE_BITS = {:g}'


def measure(
    gone_bits: float, seed: int, trials: int, duration_s: float, gaps: list[float]
) -> dict[str, Any]:
    """Measure; once only in a process, as the core that is imported first stays."""
    use_core_with([Part('presence', _LINE.format(USED_BITS), _LINE.format(gone_bits))])
    from evaluation.bench.following import ENDS, SCENES, dropped_s, false_ends, goes_on, known_of

    rng = np.random.default_rng(seed)
    ends: dict[str, list[list[float]]] = {}
    for name in ENDS:
        times = [
            known_of(partial(dropped_s, range_m, end=name), trials, rng) for range_m in RANGES_M
        ]
        ends[name] = [np.percentile(one, [50, 95]).tolist() if one else [] for one in times]
    kept = [
        [float(np.mean(known_of(partial(goes_on, range_m, gap), trials, rng))) for gap in gaps]
        for range_m in RANGES_M
    ]
    hours = trials * duration_s / 3600
    return {
        'gone_bits': gone_bits,
        'ends': ends,
        'kept': kept,
        'false_ends_an_hour': {
            scene: sum(false_ends(scene, duration_s, rng) for _ in range(trials)) / hours
            for scene in SCENES
        },
    }


if __name__ == '__main__':
    gone_bits, seed, trials, seconds, *gaps = sys.argv[1:]
    row = measure(
        float(gone_bits), int(seed), int(trials), float(seconds), [float(gap) for gap in gaps]
    )
    print(json.dumps(row))
