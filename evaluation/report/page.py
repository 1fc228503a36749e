# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report: one page of all experiments, from the figures that they have written."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from evaluation.experiments.registry import EXPERIMENTS, TIMED
from evaluation.report.claims import NOTHING, Claim

PAGE = 'README.md'
_HEADER = ('', "the paper's own", 'method `paper`', 'default, `joint`')
_INTRODUCTION = """\
Every figure here is of frames that the package's own emulator makes: a link budget derived from the
paper's figures, the noise of a VL53L8CX as measured at 8×8 zones and 10 Hz, a liquid crystal that
takes time to turn, walls that merge with the marker. No real sensor was used. Where the simulation
only gives back what was put into it, the text says so. In the tables, "the paper's own" is what its
text reports; method `paper` is our implementation of its detector, and the default is ours, both on
the same frames. Shares of trials come with 95 % confidence in the JSON; bands in the charts show
it.\
"""


def load(directory: Path) -> dict[str, dict[str, Any]]:
    """Return the figures of all experiments that have been written to a directory, by name."""
    return {
        name: json.loads(path.read_text(encoding='utf-8'))
        for name in EXPERIMENTS
        if (path := directory / f'{name}.json').exists()
    }


def table(claims: Sequence[Claim], header: Sequence[str] = _HEADER) -> str:
    """Return claims as a Markdown table, without columns that say nothing."""
    rows = [tuple(claim) for claim in claims]
    kept = [
        column
        for column in range(len(header))
        if column in (0, 3) or any(row[column] != NOTHING for row in rows)
    ]
    lines = [[header[column] for column in kept], ['---'] * len(kept)]
    lines += [[row[column] for column in kept] for row in rows]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def _command(name: str, run: Mapping[str, Any]) -> str:
    options = ['--quick'] if run['quick'] else []
    if run['seed'] != 1:
        options.append(f'--seed {run["seed"]}')
    arguments = ' '.join([name, *options])
    return 'make evaluate ARGS=' + (f"'{arguments}'" if options else arguments)


def _anchor(title: str) -> str:
    """Return the anchor that Markdown gives a heading."""
    plain = ''.join(one for one in title.lower() if one.isalnum() or one in ' -_')
    return plain.replace(' ', '-')


def _section(name: str, figures: dict[str, Any]) -> str:
    experiment = EXPERIMENTS[name]
    run = figures['run']
    alone = ', alone on the machine' if name in TIMED else ''
    source = f'{experiment.SOURCE[0].upper()}{experiment.SOURCE[1:]}. ' if experiment.SOURCE else ''
    made = f'`{_command(name, run)}`, {run["seconds"]:.0f} s{alone}; '
    return '\n\n'.join(
        [
            f'## {experiment.TITLE}',
            f'{source}{made}figures: [{name}.json]({name}.json).',
            table(experiment.compare(figures)),
            f'![{experiment.TITLE}]({name}.png)',
            experiment.comment(figures),
            '<details><summary>All figures of the chart</summary>',
            f'```text\n{experiment.summarise(figures)}\n```',
            '</details>',
        ]
    )


def _machines(report: Mapping[str, dict[str, Any]]) -> str:
    """Return on what the experiments ran, and for how long in all."""
    runs = [figures['run'] for figures in report.values()]
    minutes = sum(run['seconds'] for run in runs) / 60
    kinds = []
    for run in runs:
        versions = ', '.join(
            f'{package} {number}' for package, number in run['versions'].items() if number
        )
        kind = (
            f'{run["processor"]} ({run["cores"]} cores), {run["system"]} {run["machine"]}, '
            f'Python {run["python"]}, {versions}, seed {run["seed"]}'
            + (', quick' if run['quick'] else '')
        )
        if kind not in kinds:
            kinds.append(kind)
    return (
        f'Measured on {"; and on ".join(kinds)}. All experiments took {minutes:.0f} min of a core.'
    )


def write_page(directory: Path) -> Path:
    """Write the page of all experiments whose figures are in a directory; return its path."""
    report = load(directory)
    paper = [name for name in report if EXPERIMENTS[name].SOURCE]
    beyond = [name for name in report if name not in paper]
    contents = [
        f'- [{EXPERIMENTS[name].TITLE}](#{_anchor(EXPERIMENTS[name].TITLE)})'
        + (f', {EXPERIMENTS[name].SOURCE}' if EXPERIMENTS[name].SOURCE else '')
        for name in report
    ]
    headlines = []
    for name in paper:
        first = EXPERIMENTS[name].compare(report[name])[0]
        title = EXPERIMENTS[name].TITLE
        headlines.append(first._replace(what=f'[{title}](#{_anchor(title)}): {first.what}'))
    quick = any(figures['run']['quick'] for figures in report.values())
    parts = [
        '# The evaluation',
        _INTRODUCTION,
        _machines(report),
        *(['**A quick run: few trials, wide confidence.**'] if quick else []),
        "## The paper's figures at a glance\n\n" + table(headlines),
        '## Contents\n\n' + '\n'.join(contents),
        '# The experiments of the paper',
        *(_section(name, report[name]) for name in paper),
        '# Beyond the paper',
        *(_section(name, report[name]) for name in beyond),
    ]
    path = directory / PAGE
    path.write_text('\n\n'.join(parts) + '\n', encoding='utf-8')
    return path
