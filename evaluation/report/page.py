# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report: chapters of Markdown, into which the figures of the experiments are filled.

The chapters in `pages/` hold prose and no measured figure. What experiments made is filled into
slots: `{{chart NAME}}`, `{{table NAME}}`, `{{run}}`, and, for cells of a table,
`{{claim NAME ITEM}}`.
"""

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evaluation.experiments.registry import EXPERIMENTS, save_chart
from evaluation.report.claims import Claims, markdown

PAGE = 'README.md'
_PAGES = Path(__file__).parent / 'pages'
_SLOT = re.compile(r'\{\{(\w+)(?: ([\w-]+))?(?: ([\w-]+))?\}\}')
Report = Mapping[str, dict[str, Any]]


def load(directory: Path) -> dict[str, dict[str, Any]]:
    """Return the figures of all experiments that have been written to a directory, by name."""
    return {
        name: json.loads(path.read_text(encoding='utf-8'))
        for name in EXPERIMENTS
        if (path := directory / f'{name}.json').exists()
    }


def _run(report: Report) -> str:
    """Return on what the experiments ran, and for how long."""
    kinds = set()
    for figures in report.values():
        run = figures['run']
        versions = ', '.join(f'{name} {of}' for name, of in run['versions'].items() if of)
        kinds.add(
            f'{run["processor"]} ({run["cores"]} cores), {run["system"]} {run["machine"]}, '
            f'Python {run["python"]}, {versions}, seed {run["seed"]}'
        )
    minutes = sum(figures['run']['cpu_s'] for figures in report.values()) / 60
    rough = any(figures['run']['quick'] for figures in report.values())
    return (
        ('**A quick run: few trials, rough figures.** ' if rough else '')
        + f'Measured on {"; and on ".join(sorted(kinds))}. All experiments took {minutes:.0f} '
        'minutes of a core.'
    )


def filled(text: str, report: Report) -> str:
    """Return a chapter with its figures; ValueError for a slot that nothing fills."""

    def fill(slot: re.Match[str]) -> str:
        kind, name, item = slot.groups()
        if kind == 'run':
            return _run(report)
        if name not in report:
            raise ValueError(f'{slot[0]}: there is no experiment of that name, or it has not run')
        if kind == 'chart':
            return f'![{EXPERIMENTS[name].TITLE}]({name}.png)\n\n[figures]({name}.json)'
        if kind == 'table':
            return markdown(EXPERIMENTS[name].table(report[name]))
        if kind == 'claim':
            claims: Claims = getattr(EXPERIMENTS[name], 'claims', lambda figures: {})(report[name])
            if item in claims:
                return claims[item].cells
        raise ValueError(f'{slot[0]}: a slot is a chart, a table, a claim or the run')

    return _SLOT.sub(fill, text)


def write_page(directory: Path) -> Path:
    """Write page and charts of the figures that are in a directory; return the page's path."""
    report = load(directory)
    for name, figures in report.items():
        save_chart(name, figures, directory)
    chapters = sorted(_PAGES.glob('*.md'))
    path = directory / PAGE
    parts = [filled(chapter.read_text(encoding='utf-8').strip(), report) for chapter in chapters]
    path.write_text('\n\n'.join(parts) + '\n', encoding='utf-8')
    return path
