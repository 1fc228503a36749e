# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""False IDs of the default as shipped, in scenes without a marker in which nothing blinks.

A budget of one in ten hours takes days of frames to check. So this runs by itself, and adds to a
file: hours and false IDs by the revision of the core, the seed, and the disturbance.
"""

import hashlib
import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.bench.disturbances import FAMILY
from evaluation.bench.rates import Frequency, frequency
from evaluation.report.chart_style import label, look, new_chart
from evaluation.report.claims import per_hour, write_figures
from retrolidar_ros.cli.processes import end_with_parent
from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.methods import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.scene.reference import SENSOR

TITLE = 'False IDs, hour by hour'
NAME = 'false-ids'
TURN_H = 0.5
MEMBERS = [member.name for member in FAMILY if not member.blinks]
HANDS, HANDS_TURNS = 'hands', 3  # of a round, in which every other member has one turn
ALL = 'all'
_CORE = Path(__file__).resolve().parents[2] / 'core' / 'src'
# Tracks follow markers that have been read; these sources read no ID.
_TRACKS = 'followed followed_range pose presence range_filter tracks tracks_begin tracks_state'


def revision() -> str:
    """Return a hash of the sources by which IDs are read."""
    total = hashlib.sha256()
    for path in sorted(_CORE.glob('*.[ch]')):
        if path.stem.removeprefix('retrolidar_') not in _TRACKS.split():
            total.update(path.name.encode() + path.read_bytes())
    return total.hexdigest()[:12]


def _turns() -> list[tuple[str, int]]:
    """Return the turns of a round: a member, and how often it had a turn before."""
    times = {name: HANDS_TURNS if name == HANDS else 1 for name in MEMBERS}
    return [(name, turn) for name in MEMBERS for turn in range(times[name])]


def _count(job: tuple[str, int, int, int, float]) -> tuple[int, float]:
    """Return the false IDs of a member's turn in a round, and what they took of a core [s]."""
    name, turn, seed, number, hours = job
    began_s = time.process_time()
    index = [member.name for member in FAMILY].index(name)
    rng = np.random.default_rng([seed, index, number, turn])
    detector = create_detector('joint', SENSOR.grid)
    blocks = FAMILY[index].blocks(3600 * hours, rng)
    events = sum(len(detector.update_all(block)) for block in blocks)
    return events, time.process_time() - began_s


def extend(
    path: Path, hours: float, *, seed: int, turn_h: float = TURN_H, processes: int | None = None
) -> Iterator[str]:
    """Count, round by round, until a file holds some hours of this core; yield the sums.

    A run that is interrupted goes on after its last whole round.
    """
    figures: dict[str, Any] = {'rows': []}
    if path.exists():
        figures = json.loads(path.read_text(encoding='utf-8'))
    own, turns = revision(), _turns()
    kept = [row for row in figures['rows'] if row['revision'] != own]
    rows = {(row['seed'], row['member']): row for row in figures['rows'] if row['revision'] == own}
    path.parent.mkdir(parents=True, exist_ok=True)
    spawn, parent = get_context('spawn'), (os.getpid(),)
    with ProcessPoolExecutor(processes, spawn, end_with_parent, parent) as pool:
        while sum(row['hours'] for row in rows.values()) < hours:
            number = rows.get((seed, MEMBERS[0]), {'rounds': 0})['rounds']
            jobs = [(*turn, seed, number, turn_h) for turn in turns]
            for (name, _), (events, cpu_s) in zip(turns, pool.map(_count, jobs), strict=True):
                none = {'revision': own, 'seed': seed, 'member': name, 'rounds': number}
                row = rows.setdefault(
                    (seed, name), none | {'hours': 0.0, 'events': 0, 'cpu_s': 0.0}
                )
                row['rounds'] = number + 1
                row['hours'] += turn_h
                row['events'] += events
                row['cpu_s'] = round(row['cpu_s'] + cpu_s, 1)
            figures = {'rows': [*kept, *rows.values()]}
            spent_s = round(sum(row['cpu_s'] for row in rows.values()), 1)
            write_figures(path, figures, seed=seed, quick=turn_h < TURN_H, cpu_s=spent_s)
            yield f'{total(figures)["hours"]:g} h: {per_hour(total(figures))} an hour'


def total(figures: dict[str, Any], member: str = ALL) -> Frequency:
    """Return the false IDs of the core that was run last, before a member or before all."""
    last = figures['rows'][-1]['revision']
    rows = [
        row for row in figures['rows'] if row['revision'] == last and member in (ALL, row['member'])
    ]
    return frequency(sum(row['events'] for row in rows), sum(row['hours'] for row in rows))


def draw(figures: dict[str, Any]) -> Any:
    """Draw false IDs an hour with their confidence, a row for each member."""
    names = [ALL, *MEMBERS[::-1]]
    one, budget = total(figures), USUAL_FALSE_IDS_PER_HOUR
    ids = 'ID' if one['events'] == 1 else 'IDs'
    title = (
        f'{one["events"]} false {ids} in {one["hours"]:g} hours without a marker: '
        f'at most {one["high"]:.2g} an hour; the budget is {budget:g}'
    )
    figure, (axis,) = new_chart(1, 1, 1.7 + 0.27 * len(names), title)
    for place, name in enumerate(names):
        one = total(figures, name)
        how = look('joint') | {'linewidth': 4 if name == ALL else 2}
        axis.plot([one['low'], one['high']], [place, place], color=how['color'], alpha=0.4)
        axis.plot(one['per_hour'], place, **how)
        beside = {'va': 'center', 'transform': axis.get_yaxis_transform()}
        axis.text(1.01, place, f'{one["events"]} in {one["hours"]:g} h', fontsize=9.5, **beside)
    axis.axvline(budget, color='0.3', linestyle='--')
    axis.set_yticks(range(len(names)), names)
    label(axis, 'false IDs an hour, with 95 % confidence; dashed: the budget', xlim=(0, None))
    return figure
