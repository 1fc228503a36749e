# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line of `make evaluate`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from evaluation.experiments.registry import EXPERIMENTS, run_experiments
from evaluation.report.page import write_page


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='evaluate',
        description='Run experiments on emulated frames; without any name, list them. Each writes '
        'NAME.json and NAME.png; --all also writes a page of Markdown that tells of all of them.',
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument('names', nargs='*', default=[], metavar='NAME', help='which to run')
    which.add_argument('--all', action='store_true', help='all of them, and the page')
    parser.add_argument('--quick', action='store_true', help='few trials: a look at each')
    parser.add_argument('--seed', type=int, default=1, help='(default: %(default)s)')
    parser.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='(default: docs/report, with --quick report_quick)',
    )
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run experiments, or list them; return the exit code."""
    options = _parser().parse_args(arguments)
    if not options.names and not options.all:
        for name, experiment in EXPERIMENTS.items():
            print(f'{name:16}{experiment.TITLE:44}{experiment.SOURCE}'.rstrip())
        return 0
    # A quick look is not to take the place of the report that stands in the repository.
    output = options.output or Path('report_quick' if options.quick else 'docs/report')
    names = list(EXPERIMENTS) if options.all else options.names
    try:
        run_experiments(names, output, quick=options.quick, seed=options.seed)
    except ValueError as error:
        print(f'evaluate: {error}', file=sys.stderr)
        return 2
    print(f'{write_page(output) if options.all else output}')
    return 0
