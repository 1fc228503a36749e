# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line of `make evaluate`: run experiments and draw their charts."""

import argparse
import os
import sys
from pathlib import Path


def main(arguments: list[str] | None = None) -> int:
    """Run experiments, or list them; return the exit code."""
    from evaluation.experiments.registry import EXPERIMENTS, LONG, run_experiments
    from evaluation.report.readme import COMMITTED, write_page

    parser = argparse.ArgumentParser(
        prog='evaluate',
        description='Run experiments on emulated frames; without any name, list them. Each writes '
        'NAME.json and NAME.png; --all also writes the report of all of them.',
    )
    which = parser.add_mutually_exclusive_group()
    which.add_argument('names', nargs='*', default=[], metavar='NAME', help='which to run')
    all_help = f'all but {" and ".join(LONG)}, and the report'
    which.add_argument('--all', action='store_true', help=all_help)
    page_help = 'the report of what has been run, and the figures of documents'
    which.add_argument('--page', action='store_true', help=page_help)
    parser.add_argument('--quick', action='store_true', help='few trials: a rough look')
    parser.add_argument('--seed', type=int, default=1, help='(default: %(default)s)')
    parser.add_argument('--processes', type=int, help='how many at once (default: one a core)')
    output_help = '(default: docs/report, with --quick report_quick)'
    parser.add_argument('-o', '--output', type=Path, metavar='DIR', help=output_help)
    options = parser.parse_args(arguments)
    if not (options.names or options.all or options.page):
        for name, experiment in EXPERIMENTS.items():
            print(f'{name:16}{experiment.TITLE}')
        return 0
    # A quick run must not overwrite the committed report.
    output = options.output or (Path('report_quick') if options.quick else COMMITTED)
    names = [one for one in EXPERIMENTS if one not in LONG] if options.all else options.names
    how = {'seed': options.seed, 'processes': options.processes}
    try:
        run_experiments(names, output, quick=options.quick, **how)
        print(write_page(output) if options.all or options.page else output)
    except ValueError as error:
        print(f'evaluate: {error}', file=sys.stderr)
        return 2
    return 0


if __name__ == '__main__':
    # Python looks in the checkout first, but only the built package has the messages.
    sys.path.append(sys.path.pop(0))
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.exit(main())
