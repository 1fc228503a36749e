# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiments by name, and what runs them."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from tqdm import tqdm

from evaluation import peers
from evaluation.bench.machine import write_figures
from evaluation.experiments import (
    ambient,
    bound,
    calibration,
    chain,
    coding,
    coffee,
    drone,
    false_alarms,
    ids,
    link_budget,
    place,
    power,
    ranging,
    reach,
    reading,
    roc,
    several,
    size,
    speed_accuracy,
    stability,
    time_to_id,
    wake_up,
    yaw,
)
from evaluation.report.claims import Claim


class Experiment(Protocol):
    """A module of this package that holds one experiment."""

    TITLE: str
    """What it is about, in a few words."""
    SOURCE: str
    """Where the paper has it; empty where it has not."""

    def run(self, rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
        """Return the figures, fit for JSON."""

    def draw(self, figures: dict[str, Any], path: Path) -> None:
        """Write the chart of the figures."""

    def summarise(self, figures: dict[str, Any]) -> str:
        """Return the figures as lines of text."""

    def compare(self, figures: dict[str, Any]) -> list[Claim]:
        """Return the paper's own values beside ours; the first line is the most telling."""

    def comment(self, figures: dict[str, Any]) -> str:
        """Return what the figures show, and where they and the paper disagree, as Markdown."""


EXPERIMENTS: dict[str, Experiment] = {
    'chain': chain,
    'ids': ids,
    'link': link_budget,
    'reading': reading,
    'false-alarms': false_alarms,
    'ranging': ranging,
    'several': several,
    'size': size,
    'yaw': yaw,
    'ambient': ambient,
    'coding': coding,
    'wake-up': wake_up,
    'power': power,
    'peers': peers,
    'coffee': coffee,
    'drone': drone,
    'reach': reach,
    'bound': bound,
    'calibration': calibration,
    'time-to-id': time_to_id,
    'speed-accuracy': speed_accuracy,
    'stability': stability,
    'roc': roc,
    'place': place,
}
"""Those of the paper first, in its order."""
TIMED = ('peers', 'speed-accuracy')
"""Those that measure processor time, and so run alone."""


def run_experiment(name: str, directory: Path, *, quick: bool, seed: int) -> str:
    """Run an experiment, write NAME.json and NAME.png, and return its summary."""
    experiment = EXPERIMENTS[name]
    began_s = time.monotonic()
    figures = experiment.run(np.random.default_rng(seed), quick=quick)
    seconds = round(time.monotonic() - began_s, 1)
    path = directory / f'{name}.json'
    write_figures(path, figures, seed=seed, quick=quick, seconds=seconds)
    # Readers get what is written, not what was computed: a tuple is a list, a key is text.
    written = json.loads(path.read_text(encoding='utf-8'))
    experiment.draw(written, directory / f'{name}.png')
    return experiment.summarise(written)


def run_experiments(
    names: Sequence[str], directory: Path, *, quick: bool = False, seed: int = 1
) -> None:
    """Run experiments, on all cores, and write their figures and charts.

    Parameters
    ----------
    names : sequence of str
        Of `EXPERIMENTS`.
    directory : Path
        Where NAME.json and NAME.png go.
    quick : bool
        Small sizes, for a look in seconds.
    seed : int
        Of all randomness; each experiment starts from it anew, so it does not matter which others
        run.

    Raises
    ------
    ValueError
        If there is no such experiment.
    """
    for name in names:
        if name not in EXPERIMENTS:
            raise ValueError(f'unknown experiment {name!r}; there is {", ".join(EXPERIMENTS)}')
    directory.mkdir(parents=True, exist_ok=True)
    untimed = [name for name in names if name not in TIMED]
    cores = min(os.cpu_count() or 1, len(untimed))
    if cores > 1:
        _run_at_once(untimed, cores, directory, quick=quick, seed=seed)
        names = [name for name in names if name in TIMED]
    for name in names:
        _tell(name, run_experiment(name, directory, quick=quick, seed=seed))


def _run_at_once(
    names: Sequence[str], cores: int, directory: Path, *, quick: bool, seed: int
) -> None:
    """Run experiments on several cores, and tell each when it is done."""
    # Their own bars would write over each other, and threads of matrix products would compete.
    quiet = {'TQDM_DISABLE': '1', 'OPENBLAS_NUM_THREADS': '1'}
    before = {key: os.environ.get(key) for key in quiet}
    os.environ.update(quiet)
    try:
        with (
            ProcessPoolExecutor(cores, mp_context=get_context('spawn')) as pool,
            tqdm(total=len(names), desc='experiments', leave=False) as progress,
        ):
            jobs = {
                pool.submit(run_experiment, name, directory, quick=quick, seed=seed): name
                for name in names
            }
            for job in as_completed(jobs):
                summary = job.result()
                with progress.external_write_mode():
                    _tell(jobs[job], summary)
                progress.update()
    finally:
        for key, value in before.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value


def _tell(name: str, summary: str) -> None:
    print(f'{name}\n{summary}', flush=True)
