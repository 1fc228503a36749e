# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the experiments of the bench share: their arguments, their detector, their processes."""

from __future__ import annotations

import argparse
import multiprocessing
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from evaluation.bench.rates import Rate
from retrolidar_ros.detector import METHODS, Detector, create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import ZoneGrid

Case = TypeVar('Case')
Result = TypeVar('Result')
_MOST_JOBS = 2


class Setup(NamedTuple):
    """Which detector is judged, and the seed of all randomness."""

    seed: int = 1
    registered: int | None = None
    """How many IDs are registered; None = all may come."""
    false_ids_per_hour: float | None = None
    """The detector's budget; None = as shipped."""
    method: str = METHODS[0]

    @property
    def ids(self) -> NDArray[np.int64]:
        """The IDs that may come; registered ones are drawn at random, shape (n,)."""
        if self.registered is None:
            return USABLE_IDS
        drawn = np.random.default_rng([self.seed, self.registered])
        return np.sort(drawn.choice(USABLE_IDS, self.registered, replace=False))

    def detector(self, grid: ZoneGrid, **options: Any) -> Detector:
        """Return a new detector for the zones of a grid."""
        if self.registered is not None:
            options['registered_ids'] = self.ids
        if self.false_ids_per_hour is not None:
            options['false_ids_per_hour'] = self.false_ids_per_hour
        return create_detector(self.method, grid, **options)

    def rng(self, *case: int) -> np.random.Generator:
        """Return the generator of one case, whichever other cases there are."""
        return np.random.default_rng([self.seed, *case])


def arguments(description: str | None, runs: int | None = None) -> argparse.ArgumentParser:
    """Return a parser of what all experiments of the bench take.

    Parameters
    ----------
    description : str or None
        What the experiment tells.
    runs : int or None
        How many runs there are unless told otherwise; None = it has no runs.
    """
    parser = argparse.ArgumentParser(description=description)
    if runs is not None:
        parser.add_argument('--runs', type=int, default=runs, help='of each case (%(default)s)')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--registered', type=int, metavar='N', help='only N random IDs may come')
    parser.add_argument('--budget', type=float, metavar='F', help='false IDs an hour')
    parser.add_argument('--method', choices=METHODS, default=METHODS[0])
    parser.add_argument('--jobs', type=int, default=1, choices=range(1, _MOST_JOBS + 1))
    return parser


def setup_of(told: argparse.Namespace) -> Setup:
    """Return the setup that the arguments name."""
    return Setup(told.seed, told.registered, told.budget, told.method)


def spread(work: Callable[[Case], Result], cases: Sequence[Case], jobs: int = 1) -> list[Result]:
    """Return the results of all cases, in their order, from one or more processes."""

    def watched(results: Iterator[Result]) -> list[Result]:
        unseen = not sys.stderr.isatty()
        return list(tqdm(results, total=len(cases), leave=False, disable=unseen))

    if jobs == 1:
        return watched(map(work, cases))
    with multiprocessing.get_context('spawn').Pool(jobs) as pool:
        return watched(pool.imap(work, cases))


def told_rate(share: Rate) -> str:
    """Return a share with its 95 % interval as text."""
    return f'{share["rate"]:.3f} ({share["low"]:.3f}–{share["high"]:.3f})'
