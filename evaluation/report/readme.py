# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report, and the figures of the README and of docs/, written from those of experiments.

The report is chapters of Markdown. Those in `pages/` hold prose and no measured figure. What
experiments made is filled into slots: `{{chart NAME}}`, `{{table NAME}}`, `{{table NAME ITEM}}` for
another table of it, `{{run}}`, and, for cells of a table, `{{claim NAME ITEM}}`.

In the README and in docs/ figures stand between comments that name them.
"""

import json
import re
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from textwrap import fill as wrapped
from typing import Any

from evaluation.experiments.registry import EXPERIMENTS, LONG, save_chart
from evaluation.report.blocks import BLOCKS, Report
from evaluation.report.claims import Claims, markdown
from evaluation.report.verdicts import cells

PAGE, COMMITTED = 'README.md', Path('docs/report')
_PAGES = Path(__file__).parent / 'pages'
_SLOT = re.compile(r'\{\{(\w+)(?: ([\w-]+))?(?: ([\w-]+))?\}\}')
BENCHMARKS = ('bench-detector', 'bench-nodes')
ALL = (*EXPERIMENTS, *BENCHMARKS)
_BLOCK = re.compile(r'(<!-- figures: (\S+) -->\n).*?(\n<!-- end of figures -->)', re.DOTALL)
_DOCUMENTS = (Path('README.md'), *sorted(Path('docs').glob('*.md')))


def load(directory: Path, names: Iterable[str] = EXPERIMENTS) -> dict[str, dict[str, Any]]:
    """Return the figures that have been written to a directory, by what made them."""
    return {
        name: json.loads(path.read_text(encoding='utf-8'))
        for name in names
        if (path := directory / f'{name}.json').exists()
    }


def _run(report: Report) -> str:
    runs = [figures['run'] for figures in report.values()]
    software = defaultdict[str, dict[str, set[int]]](lambda: defaultdict(set))
    for run in runs:
        versions = ', '.join(f'{name} {of}' for name, of in run['versions'].items() if of)
        kind = f'{run["system"]} {run["machine"]}, Python {run["python"]}, {versions}'
        software[kind][f'{run["processor"]} ({run["cores"]} cores)'].add(run['seed'])
    where = [
        f'{processor}, seeds {", ".join(map(str, sorted(seeds)))}, with {kind}'
        for kind, processors in sorted(software.items())
        for processor, seeds in sorted(processors.items())
    ]
    if len(software) == 1:
        (kind,) = software
        where = [text.removesuffix(f', with {kind}') for text in where]
        where[-1] += f'; with {kind}'
    minutes = sum(run['cpu_s'] for run in runs) / 60
    rough = any(run['quick'] for run in runs)
    quick = '**A quick run: few trials, rough figures.** ' if rough else ''
    text = f'Measured on {"; ".join(where)}. All experiments took {minutes:.0f} minutes of a core.'
    return wrapped(quick + text, 120)


def filled(text: str, report: Report) -> str:
    """Return a chapter with its figures; ValueError for a slot that nothing fills."""

    def fill(slot: re.Match[str]) -> str:
        kind, name, item = slot.groups()
        if kind == 'run':
            return _run(report)
        if name in LONG and name not in report:
            return f'`{name}` has not been run here.'
        if name not in report:
            raise ValueError(f'{slot[0]}: there is no experiment of that name, or it has not run')
        if kind == 'chart':
            return f'[![{EXPERIMENTS[name].TITLE}]({name}.png)]({name}.json)'
        if kind == 'table':
            made = getattr(EXPERIMENTS[name], f'{item}_table' if item else 'table')
            return markdown(made(report[name]))
        if kind == 'claim':
            claims: Claims = getattr(EXPERIMENTS[name], 'claims', lambda figures: {})(report[name])
            if item in claims:
                return cells(f'{name} {item}', claims[item])
        raise ValueError(f'{slot[0]}: a slot is a chart, a table, a claim or the run')

    return _SLOT.sub(fill, text)


def write_page(directory: Path) -> Path:
    """Write page and charts of the figures in a directory; return the page's path.

    Those of the committed report are written into the documents, too.
    """
    report = load(directory)
    for name, figures in report.items():
        save_chart(name, figures, directory)
    chapters = sorted(_PAGES.glob('*.md'))
    path = directory / PAGE
    parts = [filled(chapter.read_text(encoding='utf-8').strip(), report) for chapter in chapters]
    path.write_text('\n\n'.join(parts) + '\n', encoding='utf-8')
    if directory == COMMITTED:
        report = load(directory, ALL)
        for document in _DOCUMENTS:
            text = renewed(document.read_text(encoding='utf-8'), report)
            document.write_text(text, encoding='utf-8')
    return path


def renewed(text: str, report: Report) -> str:
    """Return a document with its figures from a report; KeyError for what nothing makes."""
    return _BLOCK.sub(lambda found: found[1] + BLOCKS[found[2]](report) + found[3], text)
