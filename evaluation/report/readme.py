# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of the README and of docs/, written from those of the report.

    python3 -m evaluation.report.readme

renews them in the repository's root. They stand between comments that name them, so nobody has to
copy a number by hand; the tests compare.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from evaluation.bench.sweep import told
from evaluation.experiments.registry import EXPERIMENTS
from evaluation.report.claims import Claim
from evaluation.report.page import table
from retrolidar_ros.detector import METHODS

Report = Mapping[str, dict[str, Any]]
BENCHMARKS = ('bench-detector', 'bench-nodes')
_HEADLINES = {
    'reading': (0, 2),
    'size': (0,),
    'several': (0,),
    'ranging': (0,),
    'false-alarms': (0, 1),
    'coffee': (0,),
    'drone': (0,),
    'power': (0,),
    'peers': (4, 5, 6, 10, 13),
}
"""Experiments, and which lines of their comparison go to the first screen."""
_BLOCK = re.compile(r'(<!-- figures: (\S+) -->\n).*?(\n<!-- end of figures -->)', re.DOTALL)


def load_report(directory: Path) -> Report:
    """Return the figures of all experiments and benchmarks in a directory, by name."""
    return {
        name: json.loads((directory / f'{name}.json').read_text(encoding='utf-8'))
        for name in (*EXPERIMENTS, *BENCHMARKS)
    }


def _claims(report: Report, name: str) -> list[Claim]:
    return EXPERIMENTS[name].compare(report[name])


def headlines(report: Report) -> str:
    """Return the most telling lines of the paper's experiments."""
    claims = []
    for name, rows in _HEADLINES.items():
        for row in rows:
            claim = _claims(report, name)[row]
            # Their lines say little without what they are about.
            about = f'{EXPERIMENTS[name].TITLE}: ' if name in ('coffee', 'drone') else ''
            claims.append(claim._replace(what=about + claim.what))
    return table(claims)


def jobs(report: Report) -> str:
    """Return all lines of the coffee arm and of the drone."""
    return table(
        [
            claim._replace(what=f'{EXPERIMENTS[name].TITLE}: {claim.what}')
            for name in ('coffee', 'drone')
            for claim in _claims(report, name)
        ]
    )


def reach(report: Report) -> str:
    """Return how far markers are read, and what of it is wrong."""
    figures = report['reach']
    lines = ['| four of five markers are read to | default | method `paper` |', '|---|---|---|']
    for row in figures['reach_m']:
        packets = (
            'one packet (1.3 s)' if row['packets'] == 1 else f'within {row["packets"]} packets'
        )
        ends = ' | '.join(told(row[method]) for method in METHODS)
        lines.append(f'| {100 * row["size_m"]:g} cm, {packets} | {ends} |')
    wrong = {
        method: max(row[method]['wrong']['rate'] for row in figures['points']) for method in METHODS
    }
    needed = report['bound']['needed_db']
    lines += [
        '',
        (
            f'The largest share of markers of which a wrong ID was read: {wrong["joint"]:.1%}, and '
            f'{wrong["paper"]:.0%} by `paper`. Within 3 or 8 packets means `max_packets` of as '
            'many.'
        ),
        (
            'Without any test of acceptance the search needs '
            f'{needed["joint"] - needed["told"]:.1f} dB more signal than a receiver that is told '
            'all but the word.'
        ),
    ]
    return '\n'.join(lines)


def ids(report: Report) -> str:
    """Return how many IDs keep each distance."""
    sets = report['ids']['sets']
    lines = [
        ['least distance', *(str(row['distance']) for row in sets)],
        ['---'] * (len(sets) + 1),
        ['IDs found', *(str(row['ids']) for row in sets)],
    ]
    return '\n'.join(f'| {" | ".join(line)} |' for line in lines)


def speed(report: Report) -> str:
    """Return whether it keeps up."""
    nodes = report['bench-nodes']
    costs = report['bench-detector']['against']['rows']
    shares, seen = nodes['core_shares'], nodes['delays']['MarkerDetection']
    detector = '`embedded/run python benchmarks/bench_detector.py`'
    bench = '`embedded/run python benchmarks/bench_nodes.py`'
    rows = [
        (
            (
                f'{nodes["seconds"]:.0f} s at {nodes["rate_hz"]:.1f} Hz through port, driver, '
                f'detector and DDS, {nodes["run"]["cores"]} cores'
            ),
            (
                f'{nodes["lost"]} frames lost; driver {shares["driver"]:.0%}, detector '
                f'{shares["detector"]:.0%} of a core'
            ),
            bench,
        ),
        *(
            (
                f'a frame by `joint`, {cost["case"]}; a bag to JSON',
                (
                    f'{cost["new"]["frame_us"]:.0f} µs of processor time, at most '
                    f'{cost["new"]["longest_us"] / 1e3:.1f} ms; '
                    f'{cost["new"]["bag_times_real_time"]:.0f} times real time'
                ),
                detector,
            )
            for cost in costs
        ),
        (
            'from the end of the exposure to the detection, median and 99 %',
            f'{seen["median_ms"]:.0f} and {seen["p99_ms"]:.0f} ms',
            bench,
        ),
        (
            'stamps against the true exposure, once settled',
            (
                f'{nodes["stamp_stddev_ms"]:.2f} ms standard deviation, '
                f'{nodes["stamp_worst_ms"]:.2f} ms at most'
            ),
            bench,
        ),
    ]
    lines = ['| | | command |', '|---|---|---|', *(f'| {" | ".join(row)} |' for row in rows)]
    return '\n'.join(lines)


def against_table(against: Mapping[str, Any]) -> str:
    """Return what frames cost an earlier revision and this one."""
    costs = {row['case']: row for row in against['rows']}
    lines = [
        f'| method `joint` | revision {against["revision"]} | now | times better |',
        '|---|---|---|---|',
    ]
    for case, row in costs.items():
        old, new = row['old'], row['new']
        for key, what in (
            ('frame_us', 'processor time of a frame [µs]'),
            ('longest_us', 'longest frame [µs]'),
            ('bag_times_real_time', 'from a bag to JSON [times real time]'),
        ):
            better = new[key] / old[key] if key == 'bag_times_real_time' else old[key] / new[key]
            lines.append(f'| {case}: {what} | {old[key]:.0f} | {new[key]:.0f} | {better:.1f} |')
    for scene in ('quiet', 'three markers'):
        old, new = (
            costs[f'8×8 zones, {scene}'][age]['frame_us']
            / costs[f'4×4 zones, {scene}'][age]['frame_us']
            for age in ('old', 'new')
        )
        lines.append(f'| {scene}: a frame of 8×8 zones over one of 4×4 | {old:.1f} | {new:.1f} | |')
    return '\n'.join(lines)


def revisions(report: Report) -> str:
    """Return what the default method costs beside an earlier revision."""
    return against_table(report['bench-detector']['against'])


_BLOCKS = {
    'headlines': headlines,
    'jobs': jobs,
    'ids': ids,
    'reach': reach,
    'speed': speed,
    'revisions': revisions,
}
_DOCUMENTS = (Path('README.md'), *sorted(Path('docs').glob('*.md')))


def renewed(text: str, report: Report) -> str:
    """Return a document with its figures from a report.

    Raises
    ------
    KeyError
        For figures that nothing makes.
    """
    return _BLOCK.sub(lambda found: found[1] + _BLOCKS[found[2]](report) + found[3], text)


if __name__ == '__main__':
    FIGURES = load_report(Path('docs/report'))
    for document in _DOCUMENTS:
        document.write_text(
            renewed(document.read_text(encoding='utf-8'), FIGURES), encoding='utf-8'
        )
