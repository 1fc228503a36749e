# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiments by name, and what runs them."""

from __future__ import annotations

import json
import platform
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from retrolidar_ros.evaluation import (
    bound,
    coffee,
    drone,
    place,
    reach,
    reading,
    roc,
    speed_accuracy,
    stability,
    time_to_id,
)


class Experiment(Protocol):
    """A module of this package that holds one experiment."""

    def run(self, rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
        """Return the figures, fit for JSON."""

    def draw(self, figures: dict[str, Any], path: Path) -> None:
        """Write the chart of the figures."""

    def summarise(self, figures: dict[str, Any]) -> str:
        """Return the figures as lines of text."""


EXPERIMENTS: dict[str, Experiment] = {
    'reading': reading,
    'reach': reach,
    'bound': bound,
    'place': place,
    'stability': stability,
    'speed-accuracy': speed_accuracy,
    'roc': roc,
    'time-to-id': time_to_id,
    'coffee': coffee,
    'drone': drone,
}


def run_experiments(
    names: Sequence[str], directory: Path, *, quick: bool = False, seed: int = 1
) -> None:
    """Run experiments and write their figures and charts.

    Parameters
    ----------
    names : sequence of str
        Of `EXPERIMENTS`; empty = all.
    directory : Path
        Where NAME.json and NAME.png go.
    quick : bool
        Small sizes, for a look in seconds.
    seed : int
        Of all randomness; each experiment starts from it anew.

    Raises
    ------
    ValueError
        If there is no such experiment.
    """
    for name in names:
        if name not in EXPERIMENTS:
            raise ValueError(f'unknown experiment {name!r}; there is {", ".join(EXPERIMENTS)}')
    directory.mkdir(parents=True, exist_ok=True)
    for name in names or EXPERIMENTS:
        experiment = EXPERIMENTS[name]
        began = time.monotonic()
        figures = experiment.run(np.random.default_rng(seed), quick=quick)
        figures['run'] = {
            'seed': seed,
            'quick': quick,
            'seconds': round(time.monotonic() - began, 1),
            'machine': platform.machine(),
            'python': platform.python_version(),
            'numpy': np.__version__,
        }
        (directory / f'{name}.json').write_text(json.dumps(figures, indent=1) + '\n')
        experiment.draw(figures, directory / f'{name}.png')
        print(f'{name}\n{experiment.summarise(figures)}')
