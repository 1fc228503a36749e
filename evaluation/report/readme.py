# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report, and the figures of the README and of docs/, written from those of experiments.

The report is chapters of Markdown. Those in `pages/` hold prose and no measured figure. What
experiments made is filled into slots: `{{chart NAME}}`, `{{table NAME}}`, `{{run}}`, and, for cells
of a table, `{{claim NAME ITEM}}`.

    python3 -m evaluation.report.readme

renews the figures of the README and of docs/ in the repository's root. They stand between comments
that name them, so nobody has to copy a number by hand; the tests compare.
"""

import json
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from evaluation.bench.judging import BOTH
from evaluation.experiments import laboratory, peers, roc, speed_accuracy, stability
from evaluation.experiments.registry import EXPERIMENTS, save_chart
from evaluation.experiments.sweeps import end_of
from evaluation.peers.visual_markers import APRILTAG
from evaluation.report.claims import NOTHING, Claims, Table, as_text, markdown
from retrolidar_ros.detector.paper import LIKELIHOOD_THRESHOLD
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS

Report = Mapping[str, dict[str, Any]]
PAGE = 'README.md'
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


_PACKET = f'{PACKET_BITS * BIT_PERIOD_S:.1f} s'
_COSTS = (
    ('joint: packets combined', '1'),
    ('paper: threshold', f'{LIKELIHOOD_THRESHOLD:g}'),
    ('AprilTag: decimation', '2'),
)


def headlines(report: Report) -> str:
    """Return what is read, how far, how fast, beside an AprilTag of the same size."""
    figures, names = report['peers'], (*BOTH, APRILTAG)

    def reach(sweep: str, digits: int = 2) -> list[str]:
        return [peers.words(figures, sweep, name, digits) for name in names]

    errors_mm = [as_text(peers.error(figures, name, 2.0, 'median'), 'mm', 1) for name in names]
    points = [speed_accuracy.at(report['speed-accuracy'], *of) for of in _COSTS]
    costs = [as_text(None if one is None else one['cpu_ms'], 'ms of a core', 0) for one in points]
    still = [roc.grouped(roc.shipped(report['roc'], method), roc.STILL) for method in BOTH]
    false_ids = []
    for one in still:
        # Where none was seen, all that is known is the upper bound.
        rate = f'{one["per_hour"]:.{0 if one["per_hour"] > 1 else 2}f}'
        words = rate if one['events'] else f'below {one["high"]:.1g}'
        false_ids.append(f'{words} ({one["events"]} in {one["hours"]:.3g} h)')
    # What, the paper's own, and the values of both methods and the AprilTag.
    rows: list[tuple[str, str, list[str]]] = [
        ('3 cm, 80 % read in one packet or picture, to', '2.6 m', reach('3 cm')),
        ('1 cm, likewise, to', '1.3 m', reach('1 cm')),
        ('duration of a packet or picture', _PACKET, [_PACKET, _PACKET, f'{1 / 30:.2f} s']),
        ('yaw at 1 m, to', '50 °', reach('yaw', 0)),
        ('speed across at 1 m (tag: 33 ms exposure), to', NOTHING, reach('speed')),
        ('median range error at 2 m', 'below 2 mm', errors_mm),
        ('light needed at 1 m', 'none', ['none', 'none', reach('light', 1)[2]]),
        ('processor time per second, one packet or picture at a time', NOTHING, costs),
        ('false IDs an hour, no marker in view', NOTHING, [*false_ids, NOTHING]),
    ]
    heads = ['', 'LiDAR, default `joint`', 'LiDAR, method `paper`', "the paper's own", 'AprilTag 3']
    return markdown([heads, *([what, *own[:2], paper, own[2]] for what, paper, own in rows)])


def reach(report: Report) -> str:
    """Return how far markers are read."""
    one, more = report['reading'], report['reach']
    curves = {
        '3 cm, one packet (1.3 s)': (one, '3 cm'),
        **{
            f'{size} cm, within {packets} packets': (more, f'{size} cm, {packets} packets')
            for size in (3, 1)
            for packets in (3, 8)
        },
        '1 cm, one packet (1.3 s)': (more, '1 cm, one packet'),
    }
    rows: Table = [['80 % are read to', 'default', 'method `paper`']]
    for what, (figures, curve) in curves.items():
        rows.append([what, *(as_text(end_of(figures, curve, method)) for method in BOTH)])
    return markdown(rows)


def speed(report: Report) -> str:
    """Return whether it keeps up."""
    nodes = report['bench-nodes']
    shares, seen = nodes['core_shares'], nodes['delays']['MarkerDetection']
    through = f'{nodes["seconds"]:.0f} s at {nodes["rate_hz"]:.1f} Hz through all'
    kept = f'{nodes["lost"]} frames lost; driver {shares["driver"]:.0%}, detector '
    stamps = f'{nodes["stamp_stddev_ms"]:.2f} ms standard deviation, '
    delays = f'{seen["median_ms"]:.0f} and {seen["p99_ms"]:.0f} ms'
    worst = f'{stamps}{nodes["stamp_worst_ms"]:.2f} ms at most'
    rows = [
        ['', ''],
        [f'{through}, {nodes["run"]["cores"]} cores', f'{kept}{shares["detector"]:.0%} of a core'],
        ['from the end of the exposure to the detection, median and 99 %', delays],
        ['stamps against the true exposure, once settled', worst],
    ]
    for cost in report['bench-detector']['against']['rows']:
        new = cost['new']
        frame = f'{new["frame_us"]:.0f} µs, at most {new["longest_us"] / 1e3:.1f} ms'
        rows.append([cost['case'], f'{frame}; {new["bag_times_real_time"]:.0f}×'])
    return markdown(rows)


_STRESSES = {
    'second': ('second marker in its zone, signal over that of the first', '%'),
    'far_wall': ('wall 1 m behind, signal over that of the marker', 'times'),
    'wander': ('signal of a wall beside it drifts within 0.5 s, by', '%'),
    'fast': ('bits shorter than `bit_period`, by', '%'),
    'slow': ('bits longer than `bit_period`, by', '%'),
    'hand': ('hand in front for', 'ms'),
    'noise': ('variance of the noise over the usual', 'times'),
}


def limits(report: Report) -> str:
    """Return what is borne near and at the end of the reach, of lone and of repeating markers."""
    figures, others = report['stability'], report['laboratory']
    conditions = [stability.named(where) for where in laboratory.CONDITIONS]
    panels = {panel['name']: panel for panel in figures['panels']}
    rows: Table = [['limit', *conditions]]
    for name, (what, unit) in _STRESSES.items():
        breaks = [panels[name]['breaks'][where] for where in conditions]
        rows.append([what, *(f'{stability.breaking_point(one["joint"])} {unit}' for one in breaks)])
    for panel in others['panels']:
        rows.append([f'{panel["title"]}, {panel["axis"]}', *laboratory.limits(panel)])
    return markdown(rows)


_BLOCKS = {
    'headlines': headlines,
    'ids': lambda report: markdown(EXPERIMENTS['ids'].table(report['ids'])),
    'limits': limits,
    'reach': reach,
    'speed': speed,
}


def renewed(text: str, report: Report) -> str:
    """Return a document with its figures from a report; KeyError for what nothing makes."""
    return _BLOCK.sub(lambda found: found[1] + _BLOCKS[found[2]](report) + found[3], text)


if __name__ == '__main__':
    FIGURES = load(Path('docs/report'), ALL)
    for document in _DOCUMENTS:
        document.write_text(
            renewed(document.read_text(encoding='utf-8'), FIGURES), encoding='utf-8'
        )
