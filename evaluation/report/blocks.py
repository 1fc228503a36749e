# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The generated tables of README and the documents, each from the figures of the experiments."""

from collections.abc import Mapping, Sequence
from typing import Any

from evaluation.bench.judging import BOTH
from evaluation.experiments import (
    false_ids,
    laboratory,
    peers,
    place,
    speed_accuracy,
    stability,
    time_to_id,
    tracks,
)
from evaluation.experiments.registry import EXPERIMENTS
from evaluation.experiments.sweeps import end_of
from evaluation.experiments.time_to_id import REGISTERED
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.visual_markers import APRILTAG
from evaluation.report.claims import NOTHING, Table, as_text, end_as_text, markdown
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS

Report = Mapping[str, dict[str, Any]]
_PACKET = f'{PACKET_BITS * BIT_PERIOD_S:.1f} s'
_COSTS = (('joint: packets combined', '1'), ('AprilTag: decimation', '2'))
_MOVING_M_S = 0.3
_PACKETS = (('reading', '3 cm'), ('reach', '3 cm, 8 packets'))
_SIDE_M = 0.4  # of the square from whose corners landmarks are looked at
_EXPOSURE = '4 ms'  # with which tags are read while they move


def _bold(cells: Sequence[str], best: int | None) -> list[str]:
    """Return cells of which the best is bold."""
    return [f'**{cell}**' if index == best else cell for index, cell in enumerate(cells)]


def _best(ours: float | None, tag: float | None, *, more_is_better: bool) -> int | None:
    """Return the column of the better value, of ours and of an AprilTag's; None: as good."""
    if ours is None or tag is None or ours == tag:
        return None if ours == tag else (0 if tag is None else 2)
    return 0 if (ours > tag) == more_is_better else 2


def _while_moving(report: Report) -> tuple[dict[str, Any], Any]:
    """Return the points of tracks at the first distance by way, and of a tag that moves across."""
    figures = report['tracks']
    points, index = {}, 0
    for curve in figures['curves']:
        if curve['range_m'] == tracks.RANGES_M[0]:
            index = [point['speed_m_s'] for point in curve['points']].index(_MOVING_M_S)
            points[curve['way'].removesuffix(' the view')] = curve['points'][index]
    tags = figures['apriltag'].get(_EXPOSURE)
    return points, tags[index]['error_mm'] if tags else None


def headlines(report: Report) -> str:
    """Return the table of the README: this package, the paper and an AprilTag."""
    figures, soon = report['peers'], report['time-to-id']
    rows: Table = [['', 'this package', 'the paper reports', 'AprilTag of that size']]

    def add(what: str, *cells: str, best: int | None = None) -> None:
        rows.append([what, *_bold(cells, best)])

    for size, paper in (('3 cm', '2.6 m'), ('1 cm', '1.3 m')):
        ours, tags = (peers.end(figures, size, name) for name in ('joint', APRILTAG))
        what = f'How far is a marker of {size} read, in one packet or image?'
        best = _best(ours, tags, more_is_better=True)
        add(
            f'… of {size}?' if len(rows) > 1 else what,
            as_text(ours),
            paper,
            as_text(tags),
            best=best,
        )
    several = end_of(report['reach'], '3 cm, 8 packets', 'joint')
    add('… of 3 cm, in 8 packets?', as_text(several), NOTHING, NOTHING)
    few_s, any_s, tag_s = (
        time_to_id.at(soon, name, 1.0) for name in (REGISTERED, 'joint', APRILTAG)
    )
    ours_s = f'{any_s}; {few_s} if only 3 IDs are in use'
    add('How soon, at 1 m?', ours_s, f'{_PACKET} and more', tag_s, best=2)
    moving, tag = _while_moving(report)
    track = next(iter(moving.values()))
    hertz = (track['updates_hz'], PICTURES_HZ)
    often = [as_text(one, 'a second', 0) for one in hertz]
    best = _best(*hertz, more_is_better=True)
    add('How often is its position updated?', often[0], 'once a packet', often[1], best=best)
    ways = [f'{as_text(point["all_mm"], "mm", 1)} {way}' for way, point in moving.items()]
    tag_mm = tag and tag['rms']
    exposed = f'{as_text(tag_mm, "mm", 1)} {next(iter(moving))}, exposed for {_EXPOSURE}'
    what = f'How exact is its range at 1 m, moving {" or ".join(moving)} at {_MOVING_M_S:g} m/s?'
    best = _best(track['all_mm'], tag_mm, more_is_better=False)
    add(what, ', '.join(ways), NOTHING, exposed, best=best)
    costs = [speed_accuracy.at(report['speed-accuracy'], *of) for of in _COSTS]
    cpu_ms = [None if one is None else one['cpu_ms'] for one in costs]
    texts = [as_text(one, 'ms a second', 0) for one in cpu_ms]
    best = _best(*cpu_ms, more_is_better=False)
    add('Processor time, of one core?', texts[0], NOTHING, texts[1], best=best)
    one = false_ids.total(report[false_ids.NAME])
    counted = f'{one["events"]} in {one["hours"]:g} h: at most {one["high"]:.2g} an hour (95 %)'
    add('How often is an ID read where there is no marker?', counted, '"none"', NOTHING)
    lux = peers.words(figures, 'light', APRILTAG, 1)
    add('Does it need light?', 'no', 'no', f'yes: {lux}', best=0)
    return markdown(rows)


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
        ends = figures['curves'][curve]['ends']
        rows.append([what, *(end_as_text(ends[method], '[m]') for method in BOTH)])
    return markdown(rows)


def telling(report: Report) -> str:
    """Return what the detector gains by knowing more of a scene."""
    soon = [time_to_id.at(report['time-to-id'], one, 1.0) for one in ('joint', REGISTERED)]
    ends = [end_of(report[of], name, 'joint') for of, name in _PACKETS]
    one, several = (as_text(end) for end in ends)
    to_and_fro = report['tracks']['curves'][len(tracks.RANGES_M)]
    point = next(one for one in to_and_fro['points'] if one['speed_m_s'] == _MOVING_M_S)
    packets_mm, track_mm = (as_text(point[name], 'mm', 0) for name in ('packets_mm', 'all_mm'))
    moving = f'{track_mm} off instead of {packets_mm}'
    looks = {
        row['places']: as_text(row['median_mm'], 'mm', 0)
        for row in report['landmarks']['places']
        if row['side_m'] == _SIDE_M and row['object'] == 'machine'
    }
    sizes = [as_text(one, '°', 1) for one in report['place']['size_told_deg']]
    few = f'with {time_to_id.FEW} of them the first ID comes after {soon[1]} instead of {soon[0]}'
    large = f'a {100 * place.LARGE_M:g} cm marker'
    told = f'the bearing of {large} is off by {sizes[1]}, and by {sizes[0]} without it'
    if sizes[0] == sizes[1]:
        told = f'little: the bearing of {large} is off by {sizes[0]} either way'
    return markdown(
        [
            ['if …', 'then …', 'which buys'],
            [
                'all IDs are known',
                'set `registered_ids`, or `marker_file` and `only_registered`',
                few,
            ],
            [
                'markers repeat their packet',
                'leave `max_packets` at 8, and `gap_bits` of the marker at 0',
                f'3 cm are read to {several} instead of {one}',
            ],
            [
                'markers stand still',
                'look from several places: `landmarks`, or `coffee` with `target_frame`',
                f'a position at 1.5 m is {looks[4]} off after four looks, {looks[1]} after one',
            ],
            [
                'markers or the robot move',
                'take `tracks`, and `tf_source: tracks`',
                f'to and fro at {_MOVING_M_S:g} m/s a range is {moving}',
            ],
            [
                'a marker is not of 3 cm',
                'give its `size` in the marker file',
                told,
            ],
        ]
    )


def speed(report: Report) -> str:
    """Return processor time, losses and delays."""
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
    for cost in report['bench-detector']['rows']:
        frame = f'{cost["frame_us"]:.0f} µs, at most {cost["longest_us"] / 1e3:.1f} ms'
        rows.append([cost['case'], f'{frame}; {cost["bag_times_real_time"]:.0f}×'])
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
    """Return limits near and at the end of the reach, of lone and of repeating markers."""
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


BLOCKS = {
    'headlines': headlines,
    'ids': lambda report: markdown(EXPERIMENTS['ids'].table(report['ids'])),
    'limits': limits,
    'reach': reach,
    'speed': speed,
    'telling': telling,
}
