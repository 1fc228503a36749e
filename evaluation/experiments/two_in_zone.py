# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two repeating markers in one zone: how often both are read within a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from evaluation.bench.link import marker_size
from evaluation.bench.rates import rate
from evaluation.bench.setup import Setup, arguments, setup_of, spread, told_rate
from evaluation.experiments.several import two_in_a_zone
from retrolidar_ros.scene import Simulation

SIGNAL = 150.0  # of the brighter one [kcps/SPAD]
SHARES = (0.25, 0.5, 0.7)
"""Signal of the fainter one over that of the brighter."""
WATCHED_S = 8.0


class Case(NamedTuple):
    """One pair."""

    share: float
    run: int
    setup: Setup


class Came(NamedTuple):
    """What was read of one pair."""

    brighter: bool
    fainter: bool
    readings: int
    wrong: int


def watch(case: Case) -> Came:
    """Simulate one pair and read it."""
    rng = case.setup.rng(round(100 * case.share), case.run)
    scene = two_in_a_zone(case.share, rng)
    ids = rng.choice(case.setup.ids, 2, replace=False).tolist()
    markers = tuple(
        replace(marker, id=identity, size_m=marker_size(size * SIGNAL))
        for marker, identity, size in zip(scene.markers, ids, (1.0, case.share), strict=True)
    )
    recording = Simulation(replace(scene, markers=markers), rng).run(WATCHED_S)
    read = [one.id for one in case.setup.detector(recording.grid).update_all(recording)]
    bright, faint = ids
    return Came(bright in read, faint in read, len(read), sum(one not in ids for one in read))


def run(
    setup: Setup, *, runs: int, shares: Sequence[float] = SHARES, jobs: int = 1
) -> dict[str, Any]:
    """Return how often the brighter, the fainter and both are read, by their ratio."""
    cases = [Case(share, index, setup) for share in shares for index in range(runs)]
    found = dict(zip(cases, spread(watch, cases, jobs), strict=True))
    rows = []
    for share in shares:
        came = [found[Case(share, index, setup)] for index in range(runs)]
        rows.append(
            {
                'share': share,
                'both': rate(sum(one.brighter and one.fainter for one in came), runs),
                'brighter': rate(sum(one.brighter for one in came), runs),
                'fainter': rate(sum(one.fainter for one in came), runs),
                'readings': sum(one.readings for one in came),
                'wrong': sum(one.wrong for one in came),
            }
        )
    return {'runs': runs, 'signal': SIGNAL, 'watched_s': WATCHED_S, 'rows': rows}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    names = ('both', 'brighter', 'fainter')
    scene = f'two markers in a zone, the brighter at {figures["signal"]:g} kcps/SPAD'
    lines = [
        f'{scene}, read within {figures["watched_s"]:g} s (95 %), {figures["runs"]} runs',
        f'{"fainter":10}' + ''.join(f'{name:>24}' for name in names) + '   wrong IDs/readings',
    ]
    lines += [
        f'{row["share"]:<10.0%}'
        + ''.join(f'{told_rate(row[name]):>24}' for name in names)
        + f'   {row["wrong"]}/{row["readings"]}'
        for row in figures['rows']
    ]
    return '\n'.join(lines)


def main() -> None:
    """Run the experiment and print its table."""
    told = arguments(__doc__, runs=20).parse_args()
    print(summarise(run(setup_of(told), runs=told.runs, jobs=told.jobs)))


if __name__ == '__main__':
    main()
