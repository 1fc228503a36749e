# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The figures of the README and of docs/scale.md, written from those of the report.

    python3 -m retrolidar_ros.evaluation.readme

renews them in the repository's root. They stand between comments that name them, so nobody has to
copy a number by hand; the tests compare.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from retrolidar_ros.detector import METHODS
from retrolidar_ros.evaluation.claims import Claim
from retrolidar_ros.evaluation.experiments import EXPERIMENTS
from retrolidar_ros.evaluation.page import table
from retrolidar_ros.evaluation.sweep import told

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
    cost = {
        row['talking']: row
        for row in report['bench-detector']['rows']
        if row['method'] == 'joint' and row['zones'] == 16
    }
    median = {
        name: row
        for row in report['speed-accuracy']['rows']
        if row['method'] == 'joint' and row['zones'] == 16
        for name in ('quiet', 'talking')
    }
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
                what,
                (
                    f'{cost[talking]["frame_us"] / 1e3:.2f} ms of processor time (median '
                    f'{median[name]["frame_us"][name] / 1e3:.2f} ms)'
                ),
                f'{detector} (`retrolidar evaluate speed-accuracy`)',
            )
            for talking, name, what in (
                (0, 'quiet', 'a frame of 16 zones by `joint`, nothing modulating'),
                (3, 'talking', 'the same, three markers talking'),
            )
        ),
        (
            'a recording of 16 zones by `update_all`, quiet or with three markers talking',
            f'{cost[0]["times_real_time"]:.0f} or {cost[3]["times_real_time"]:.0f} times real time',
            detector,
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
    lines = [
        f'| method `joint` | revision {against["revision"]} | now | ratio |',
        '|---|---|---|---|',
    ]
    for row in against['rows']:
        old, new = row['old'], row['new']
        lines += [
            f'| {row["case"]}: {what} | {old[key]:{form}} | {new[key]:{form}} '
            f'| {max(old[key] / new[key], new[key] / old[key]):.1f} |'
            for key, what, form in (
                ('frame_us', 'processor time of a frame [µs]', '.0f'),
                ('longest_us', 'longest frame [µs]', '.0f'),
                ('bag_times_real_time', 'from a bag to JSON [times real time]', '.0f'),
            )
        ]
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
_DOCUMENTS = (Path('README.md'), Path('docs/scale.md'))


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
