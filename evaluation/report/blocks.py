# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The generated tables of README and the documents, each from the figures of the experiments."""

from collections.abc import Mapping
from typing import Any

from evaluation.bench.judging import BOTH
from evaluation.experiments import false_ids, peers, speed_accuracy, stability, time_to_id, tracks
from evaluation.experiments.moving import WAYS
from evaluation.experiments.paper_sweeps import end_of
from evaluation.experiments.registry import EXPERIMENTS
from evaluation.experiments.time_to_id import REGISTERED
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.visual_markers import APRILTAG
from evaluation.report.claims import NOTHING, Table, as_text, end_as_text, markdown
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS

Report = Mapping[str, dict[str, Any]]
_PACKET = f'{PACKET_BITS * BIT_PERIOD_S:.1f} s'
_MOVING_M_S = 0.3
_PACKETS = (('reading', '3 cm'), ('reach', '3 cm, 8 packets'))
_SEVERAL = ('3 packets', '8 packets')
_SIDE_M = 0.4  # of the square from whose corners landmarks are looked at
_EXPOSURE = '4 ms'  # with which tags are read while they move


def _row(what: str, ours: str, paper: str, tag: str, *, wins: bool) -> list[str]:
    """Return a row of the headlines, bold what is better: ours if it `wins`, else the tag's."""
    return [what, f'**{ours}**', paper, tag] if wins else [what, ours, paper, f'**{tag}**']


def headlines(report: Report) -> str:
    """Return the table of the README: this package, the paper and an AprilTag."""
    figures, soon = report['peers'], report['time-to-id']
    rows: Table = [['', 'this package', 'the paper reports', 'AprilTag of that size']]
    for size, paper, what in (
        ('3 cm', '2.6 m', 'How far is a marker of 3 cm read, in one packet or image?'),
        ('1 cm', '1.3 m', '… of 1 cm?'),
    ):
        ours_m, tag_m = (peers.end(figures, size, name) or 0.0 for name in ('joint', APRILTAG))
        rows.append(_row(what, as_text(ours_m), paper, as_text(tag_m), wins=ours_m > tag_m))
    several = as_text(end_of(report['reach'], '3 cm, 8 packets', 'joint'))
    rows.append(['… of 3 cm, in 8 packets?', several, NOTHING, NOTHING])
    few_s, any_s, tag_s = (
        time_to_id.at(soon, name, 1.0) for name in (REGISTERED, 'joint', APRILTAG)
    )
    ours_s = f'{any_s}; {few_s} if only 3 IDs are in use'
    rows.append(_row('How soon, at 1 m?', ours_s, f'{_PACKET} and more', tag_s, wins=False))
    across, to_and_fro = (tracks.points_at(report['tracks'], way) for way in WAYS)
    index = [point['speed_m_s'] for point in across].index(_MOVING_M_S)
    hertz = across[index]['updates_hz']
    ours, tag = (as_text(one, 'a second', 0) for one in (hertz, PICTURES_HZ))
    what = 'How often is its position updated?'
    rows.append(_row(what, ours, 'once a packet', tag, wins=hertz > PICTURES_HZ))
    off_mm, along_mm = (points[index]['all_mm'] for points in (across, to_and_fro))
    tag_mm = report['tracks']['apriltag'][_EXPOSURE][index]['error_mm']['rms']
    what = f'How exact is its range at 1 m, moving across or to and fro at {_MOVING_M_S:g} m/s?'
    ours = f'{off_mm:.1f} mm across, {along_mm:.1f} mm to and fro'
    tag = f'{tag_mm:.1f} mm across, exposed for {_EXPOSURE}'
    rows.append(_row(what, ours, NOTHING, tag, wins=off_mm < tag_mm))
    cpu_ms = [speed_accuracy.cpu_ms(report['speed-accuracy'], one) for one in ('LiDAR', 'tag')]
    ours, tag = (as_text(one, 'ms a second', 0) for one in cpu_ms)
    driver, detector = (report['bench-nodes']['core_shares'][one] for one in ('driver', 'detector'))
    nodes = f'Both nodes, by `bench_nodes.py`: {1e3 * (driver + detector):.0f} ms a second'
    what = f'Processor time of the detection, of one core? ({nodes})'
    rows.append(_row(what, ours, NOTHING, tag, wins=cpu_ms[0] < cpu_ms[1]))
    one = false_ids.total(report['false-ids'])
    counted = f'{one["events"]} in {one["hours"]:g} h: at most {one["high"]:.2g} an hour (95 %)'
    rows.append(['How often is an ID read where there is no marker?', counted, '"none"', NOTHING])
    wrong = report['rooms']['wrong']
    counted = f'{wrong["rate"]:.2%}, at most {wrong["high"]:.2%} (95 %, if independent)'
    what = 'How many IDs are wrong in [random rooms](docs/report/README.md#how-sure-a-reading-is)?'
    rows.append([what, counted, NOTHING, NOTHING])
    lux = peers.words(figures, 'light', APRILTAG, 1)
    rows.append(_row('Does it need light?', 'no', 'no', f'yes: {lux}', wins=True))
    return markdown(rows)


def reach(report: Report) -> str:
    """Return how far markers are read, by size, method and packets."""
    curves = {
        '3 cm': (_PACKETS[0], ('reach', '3 cm, 3 packets'), _PACKETS[1]),
        '1 cm': tuple(('reach', f'1 cm, {one}') for one in ('one packet', *_SEVERAL)),
    }
    heads = (f'one packet ({_PACKET})', *(f'within {one}' for one in _SEVERAL))
    rows: Table = [['80 % are read to', *heads]]
    for size, places in curves.items():
        for method, words in zip(BOTH, ('default', 'method `paper`'), strict=True):
            ends = (report[name]['curves'][curve]['ends'][method] for name, curve in places)
            rows.append([f'{size}, {words}', *(end_as_text(end, '[m]') for end in ends)])
    return markdown(rows)


_SURE_MARGIN = 15  # [nats]
_TELLING = (
    ('all IDs are known', 'set `registered_ids`, or `marker_file` and `only_registered`'),
    ('markers repeat their packet', 'leave `max_packets` at 8, and no pause between packets'),
    (
        'markers stand still',
        'look from several places: `landmarks`, or `coffee` with `target_frame`',
    ),
    ('markers or the robot move', 'take `tracks`, and `tf_source: tracks`'),
    (
        'a wrong ID costs more than a missed one',
        f'drop readings with a `decision_margin` below {_SURE_MARGIN}',
    ),
)


def telling(report: Report) -> str:
    """Return what the detector gains by knowing more of a scene."""
    any_s, few_s = (time_to_id.at(report['time-to-id'], one, 1.0) for one in ('joint', REGISTERED))
    one, several = (as_text(end_of(report[of], name, 'joint')) for of, name in _PACKETS)
    flown = next(one for one in report['drone']['faster'] if one['speed_m_s'] == _MOVING_M_S)
    packet, track = (as_text(flown['joint'][name], 'mm', 0) for name in ('off_mm', 'followed_mm'))
    looks = {
        row['places']: as_text(row['median_mm'], 'mm', 0)
        for row in report['landmarks']['places']
        if row['side_m'] == _SIDE_M and row['object'] == 'machine'
    }
    all_of, sure = (
        next(row for row in report['rooms']['by_margin'] if row['margin'] == margin)
        for margin in (0, _SURE_MARGIN)
    )
    fewer = 1 - sure['readings'] / all_of['readings']
    wrong = (f'{one["wrong"]} of {one["readings"]}' for one in (sure, all_of))
    bought = [
        f'with {time_to_id.FEW} of them the first ID comes after {few_s} instead of {any_s}',
        f'3 cm are read to {several} instead of {one}',
        f'a position at 1.5 m is {looks[4]} off after four looks, {looks[1]} after one',
        f'at {_MOVING_M_S:g} m/s a drone is {track} from its track, {packet} from its last packet',
        f'in random rooms {" are wrong instead of ".join(wrong)}; {fewer:.0%} fewer readings',
    ]
    rows = ([*told, buys] for told, buys in zip(_TELLING, bought, strict=True))
    return markdown([['if …', 'then …', 'which buys'], *rows])


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
    'second': 'second marker in its zone, signal over that of the first [%]',
    'far_wall': 'wall 1 m behind, signal over that of the marker',
    'wander': 'signal of a wall beside it drifts within 0.5 s by [%]',
    'fast': 'bits shorter than `bit_period` by [%]',
    'slow': 'bits longer than `bit_period` by [%]',
    'hand': 'hand in front for [ms]',
    'noise': 'variance of the noise over the usual',
    'pedestal': 'a bright wall, its signal [kcps/SPAD]',
    'glass': 'a cover glass, its signal [kcps/SPAD]',
    'neighbour': "another sensor's light, while it sends [kcps/SPAD]",
}


def limits(report: Report) -> str:
    """Return limits near and at the end of the reach, of lone and of repeating markers."""
    conditions = [stability.named(where) for where in stability.LIMITS]
    panels = {panel['name']: panel for panel in report['stability']['panels']}
    rows: Table = [['limit', *conditions]]
    for name, what in _STRESSES.items():
        breaks = [panels[name]['breaks'][where] for where in conditions]
        rows.append([what, *(stability.breaking_point(one['joint']) for one in breaks)])
    return markdown(rows)


BLOCKS = {
    'headlines': headlines,
    'ids': lambda report: markdown(EXPERIMENTS['ids'].table(report['ids'])),
    'limits': limits,
    'reach': reach,
    'speed': speed,
    'telling': telling,
}
