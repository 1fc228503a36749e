# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""False IDs of the default before each disturbance, for as many sensor-hours as one has time for.

embedded/run python benchmarks/bench_false_ids.py [--hours H] [--registered N] [MEMBER...]

The experiment `roc` looks for an hour or so at each; a budget of one in ten hours needs a night.
"""

from __future__ import annotations

import argparse
import sys
import time

import numpy as np

from evaluation.bench.disturbances import FAMILY
from evaluation.bench.rates import frequency
from evaluation.report.claims import markdown
from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.budget import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.marker.dictionary import choose_ids
from retrolidar_ros.sensor.frame import ZoneGrid

TURN_H = 0.5
"""Each disturbance in turn, so that a run that is interrupted has looked at all."""


def main() -> None:
    """Count and print, from turn to turn."""
    still = [member for member in FAMILY if not member.blinks]
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('members', nargs='*', default=[member.name for member in still])
    parser.add_argument('--hours', type=float, default=TURN_H, help='of each (default: 0.5)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--registered', type=int, metavar='N', help='IDs (default: all are read)')
    arguments = parser.parse_args()
    ids = None if arguments.registered is None else choose_ids(arguments.registered)[0].tolist()
    events = dict.fromkeys(arguments.members, 0)
    watched_h, began_s = 0.0, time.process_time()
    while watched_h < arguments.hours:
        turn_h = min(TURN_H, arguments.hours - watched_h)
        for index, member in enumerate(FAMILY):
            if member.name not in events:
                continue
            detector = create_detector('joint', ZoneGrid(), registered_ids=ids)
            rng = np.random.default_rng([arguments.seed, index, round(watched_h / TURN_H)])
            for block in member.blocks(3600 * turn_h, rng):
                events[member.name] += len(detector.update_all(block))
        watched_h += turn_h
        print(f'{watched_h:g} h of each: {events}', file=sys.stderr, flush=True)
    rows = [('', 'false IDs', 'hours', 'an hour', '95 %', 'budget')]
    for name, count in {**events, 'all': sum(events.values())}.items():
        one = frequency(count, watched_h * (len(events) if name == 'all' else 1))
        numbers = (f'{count}', f'{one["hours"]:g}', f'{one["per_hour"]:.3f}')
        bounds = f'{one["low"]:.3f} to {one["high"]:.3f}'
        rows.append((name, *numbers, bounds, f'{USUAL_FALSE_IDS_PER_HOUR:g}'))
    print(markdown(rows))
    print(f'{time.process_time() - began_s:.0f} s of a core')


if __name__ == '__main__':
    main()
