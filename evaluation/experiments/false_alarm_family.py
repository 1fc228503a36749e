# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""False IDs an hour before every member of the family of scenes without a marker."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from evaluation.bench.disturbances import FAMILY, Member
from evaluation.bench.rates import exact_frequency
from evaluation.bench.setup import Setup, arguments, setup_of, spread
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import ZONE_SHAPES, ZoneGrid


class Watch(NamedTuple):
    """A stretch of one member that one detector watches."""

    member: int
    """Index in `FAMILY`."""
    part: int
    duration_s: float
    grid: ZoneGrid
    setup: Setup


class Seen(NamedTuple):
    """What came of it."""

    ids: list[int]
    candidates: int
    rejected: Counter[str]
    frames: int
    detector_s: float
    """Processor time of the detector."""
    simulation_s: float
    """Processor time of the simulation."""
    slowest_s: float
    """Processor time a frame of the slowest block."""


def watch(one: Watch) -> Seen:
    """Play a stretch of a member to a new detector."""
    rng = one.setup.rng(one.member, one.part)
    detector = one.setup.detector(one.grid)
    ids: list[int] = []
    frames = 0
    detector_s = slowest_s = 0.0
    began_s = time.process_time()
    for block in FAMILY[one.member].blocks(one.duration_s, rng, replace(SENSOR, grid=one.grid)):
        before_s = time.process_time()
        ids += (detection.id for detection in detector.update_all(block))
        taken_s = time.process_time() - before_s
        detector_s += taken_s
        slowest_s = max(slowest_s, taken_s / len(block))
        frames += len(block)
    return Seen(
        ids=ids,
        candidates=detector.counts.candidates,
        rejected=detector.counts.rejected,
        frames=frames,
        detector_s=detector_s,
        simulation_s=time.process_time() - began_s - detector_s,
        slowest_s=slowest_s,
    )


def _row(member: Member, parts: Sequence[Seen], hours: float) -> dict[str, Any]:
    """Sum up what came of a member."""
    ids = Counter(identity for one in parts for identity in one.ids)
    frames = sum(one.frames for one in parts)
    return {
        'member': member.name,
        'blinks': member.blinks,
        'false_ids': exact_frequency(ids.total(), hours),
        'most_frequent': ids.most_common(3),
        'candidates': sum(one.candidates for one in parts),
        'rejected': dict(sum((one.rejected for one in parts), Counter[str]())),
        'detector_us': 1e6 * sum(one.detector_s for one in parts) / frames,
        'slowest_us': 1e6 * max(one.slowest_s for one in parts),
        'simulation_us': 1e6 * sum(one.simulation_s for one in parts) / frames,
    }


def run(
    setup: Setup,
    *,
    hours: float,
    members: Sequence[Member] = FAMILY,
    grid: ZoneGrid = SENSOR.grid,
    jobs: int = 1,
) -> dict[str, Any]:
    """Return false IDs an hour and processor time a frame, by member.

    Parameters
    ----------
    setup : Setup
        Which detector.
    hours : float
        How long it watches each member [h]; a part of it in each process.
    members : sequence of Member
        Of `FAMILY`.
    grid : ZoneGrid
        The sensor's zones.
    jobs : int
        How many processes.
    """
    watches = [
        Watch(FAMILY.index(member), part, 3600 * hours / jobs, grid, setup)
        for member in members
        for part in range(jobs)
    ]
    parts = iter(spread(watch, watches, jobs))
    rows = [_row(member, list(itertools.islice(parts, jobs)), hours) for member in members]
    still = [row['false_ids']['events'] for row in rows if not row['blinks']]
    return {
        'hours': hours,
        'zones': grid.zones,
        'registered': setup.registered,
        'budget': setup.false_ids_per_hour,
        'rows': rows,
        'all': exact_frequency(sum(still), hours * len(still)) if still else None,
    }


def _told(row: dict[str, Any]) -> str:
    """Return a member's line of the table."""
    found = row['false_ids']
    name = f'{row["member"]} (blinks)' if row['blinks'] else row['member']
    interval = f'{found["per_hour"]:.3g} ({found["low"]:.3g}–{found["high"]:.3g})'
    most = ' '.join(f'{identity}×{times}' for identity, times in row['most_frequent'])
    return (
        f'{name:24}{found["events"]:6d}{interval:>28}{row["detector_us"]:10.1f}'
        f'{row["slowest_us"]:10.1f}{row["simulation_us"]:10.1f}  {most}'
    )


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    registered = figures['registered'] or 'all'
    budget = 'as shipped' if figures['budget'] is None else f'{figures["budget"]:g} an hour'
    watched = f'{figures["hours"]:g} h a member, {figures["zones"]} zones'
    times = ''.join(f'{name:>10}' for name in ('µs/frame', 'slowest', 'scene'))
    lines = [
        f'false IDs, {watched}, budget {budget}, registered IDs: {registered}',
        f'{"":24}{"IDs":>6}{"an hour (exact 95 %)":>28}{times}  most frequent',
        *map(_told, figures['rows']),
    ]
    if figures['all'] is not None:
        found = figures['all']
        lines.append(
            f'all that do not blink: {found["events"]} in {found["hours"]:g} h = '
            f'{found["per_hour"]:.3g} an hour ({found["low"]:.3g}–{found["high"]:.3g})'
        )
    return '\n'.join(lines)


def main() -> None:
    """Run the experiment and print its table."""
    shapes = {f'{rows}x{columns}': ZoneGrid(rows, columns) for rows, columns in ZONE_SHAPES}
    parser = arguments(__doc__)
    parser.add_argument('--hours', type=float, default=0.05, help='of each member (%(default)s)')
    parser.add_argument('--zones', choices=shapes, default='4x4')
    parser.add_argument('--only', metavar='TEXT', default='', help='members named so')
    told = parser.parse_args()
    members = [member for member in FAMILY if told.only in member.name]
    figures = run(
        setup_of(told),
        hours=told.hours,
        members=members,
        grid=shapes[told.zones],
        jobs=told.jobs,
    )
    print(summarise(figures))


if __name__ == '__main__':
    main()
