# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiments by name, and what runs them.

An experiment is a module, or an object, with a `TITLE` of a few words, and a function `run`, which
returns figures fit for JSON. It may have `draw`, which makes the chart of figures, a `table` of
them, `claims`, which are what items of the paper come to, and `draw_panels`, a chart of details.
"""

import json
import os
import resource
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.experiments.core_changes import CORE_CHANGES
from evaluation.experiments.paper_sweeps import SWEEPS
from evaluation.report.chart_style import mark_rough
from evaluation.report.claims import markdown, write_figures
from evaluation.report.verdicts import cells
from retrolidar_ros.cli.processes import end_with_parent

_NAMES = """
    speed-accuracy time-to-id peers roc false-ids rooms stability moving tracks
    coffee drone several place ranging bound chain ids reading reach
    angle ambient marker landmarks parts track-parts numbers
"""
_OBJECTS: dict[str, Any] = SWEEPS | CORE_CHANGES
EXPERIMENTS: dict[str, Any] = {
    name: _OBJECTS.get(name) or import_module(f'evaluation.experiments.{name.replace("-", "_")}')
    for name in _NAMES.split()
}
TIMED = ('speed-accuracy',)  # those that measure processor time, and so run alone
_LONGEST = ('rooms', 'roc', 'stability', 'moving')  # begun first, so that none is waited for
LONG = ('false-ids', 'parts', 'track-parts', 'numbers')
"""Those that take long, and so run by their names only."""


def save_chart(name: str, figures: dict[str, Any], directory: Path) -> None:
    """Draw the chart of an experiment to NAME.png, and its details, if any, to NAME-panels.png."""
    experiment = EXPERIMENTS[name]
    for draw, file in (('draw', name), ('draw_panels', f'{name}-panels')):
        if hasattr(experiment, draw):
            chart = getattr(experiment, draw)(figures)
            if figures['run']['quick']:
                mark_rough(chart)
            chart.savefig(directory / f'{file}.png')


def _cpu_s() -> float:
    """Return the processor time of this process and of those that it started and that ended."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def run_experiment(name: str, directory: Path, *, quick: bool, seed: int) -> str:
    """Run an experiment, write NAME.json and NAME.png; return its table and claims as text."""
    experiment = EXPERIMENTS[name]
    began_s, began_cpu_s = time.monotonic(), _cpu_s()
    figures = experiment.run(np.random.default_rng(seed), quick=quick)
    seconds = round(time.monotonic() - began_s, 1)
    cpu_s = round(_cpu_s() - began_cpu_s, 1)
    path = directory / f'{name}.json'
    write_figures(path, figures, seed=seed, quick=quick, seconds=seconds, cpu_s=cpu_s)
    # From the file: JSON has made tuples lists, and keys text.
    written = json.loads(path.read_text(encoding='utf-8'))
    save_chart(name, written, directory)
    rough = ' QUICK RUN: ROUGH' if quick else ''
    lines = [f'{name}: {experiment.TITLE} ({cpu_s} s of a core){rough}']
    if hasattr(experiment, 'table'):
        lines.append(markdown(experiment.table(written)))
    if hasattr(experiment, 'claims'):
        claims = experiment.claims(written).items()
        lines += [f'{item}: {cells(f"{name} {item}", claim)}' for item, claim in claims]
    return '\n'.join([*lines, ''])


def run_experiments(
    names: Sequence[str], directory: Path, *, quick: bool, seed: int, processes: int | None
) -> None:
    """Run experiments, and write their figures and charts as NAME.json and NAME.png.

    Each starts from the seed, so it does not matter which others run. As many run at once as
    there are cores, unless set otherwise; those that take times run alone. Raises ValueError if
    there is no such experiment.
    """
    for name in names:
        if name not in EXPERIMENTS:
            raise ValueError(f'unknown experiment {name!r}; there is {", ".join(EXPERIMENTS)}')
    directory.mkdir(parents=True, exist_ok=True)
    untimed = [name for name in names if name not in TIMED]
    untimed.sort(key=lambda name: name not in _LONGEST)
    one = partial(run_experiment, directory=directory, quick=quick, seed=seed)
    cores = min(processes or os.cpu_count() or 1, len(untimed))
    if cores > 1:
        spawn, parent = get_context('spawn'), (os.getpid(),)
        with ProcessPoolExecutor(cores, spawn, end_with_parent, parent) as pool:
            for job in as_completed([pool.submit(one, name) for name in untimed]):
                print(job.result(), flush=True)
        names = [name for name in names if name in TIMED]
    for name in names:
        print(one(name), flush=True)
