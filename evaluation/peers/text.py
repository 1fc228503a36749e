# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the figures of LiDAR markers beside visual markers say, in words and tables."""

from __future__ import annotations

from typing import Any

from evaluation.bench.rates import falls_below
from evaluation.peers.chart import SPEED_ACCURACY
from evaluation.peers.claims import error_mm, metres, more, reach_m, text
from evaluation.peers.visual_markers import APRILTAG, APRILTAG_FINE
from evaluation.report.charts import LEVEL


def summarise(figures: dict[str, Any]) -> str:
    """Return tables of the figures."""
    names = [*figures['methods'], *figures['readers']]
    wide = max(map(len, names)) + 2
    lines = [
        f'right [%] in one packet or picture (in {figures["packet_s"]:.1f} s), range error [mm]'
    ]
    for place in figures['places']:
        lines.append(f'{100 * place["size_m"]:.0f} cm at {place["range_m"]:.1f} m')
        for name in names:
            result = place['results'][name]
            error = result['error_mm']
            lines.append(
                f'  {name:{wide}}{100 * result["read"]["rate"]:4.0f} '
                f'({100 * result["in_packet_time"]:3.0f})'
                + (f'{error["median"]:8.1f} {error["p95"]:7.1f}' if error else '')
            )
    for rows, key in ((figures['lights'], 'lux'), (figures['glares'], 'veil')):
        lines.append(f'right [%] over {key}: ' + ', '.join(f'{row[key]:g}' for row in rows))
        lines += [
            f'  {name:{wide}}'
            + ' '.join(f'{100 * row["results"][name]["read"]["rate"]:4.0f}' for row in rows)
            for name in figures['readers']
        ]
    lines.append(f'{LEVEL:.0%} are read to; processor time per second of watching')
    for name in names:
        reading = figures['reading'][name]
        ends = ', '.join(
            f'{size} {metres(reach["single"])}' for size, reach in reading['reach_m'].items()
        )
        quiet = reading['quiet_cpu_ms']
        lines.append(
            f'  {name:{wide}}{ends}; {reading["cpu_ms"]:.0f} ms'
            + ('' if quiet is None else f', {quiet:.0f} ms with no marker')
        )
    lines += [f'left out: {name}: {reason}' for name, reason in figures['missing'].items()]
    return '\n'.join(lines)


def comment(figures: dict[str, Any]) -> str:
    """Return what the figures show, for the report."""
    picture = f'![Reach and range error over processor time]({SPEED_ACCURACY})'
    parts = [_setting(figures), picture, _table(figures)]
    if APRILTAG not in figures['missing']:
        parts += [_beside_tags(figures), _tags_of_the_paper(figures)]
    if figures['readers']:
        parts.append(_light(figures))
    parts.append(_cost(figures))
    if figures['missing']:
        reasons = '; '.join(f'{name}: {reason}' for name, reason in figures['missing'].items())
        parts.append(f'Left out of this run: {reasons}.')
    return '\n\n'.join(parts)


def _setting(figures: dict[str, Any]) -> str:
    many = figures['pictures_of_a_packet']
    return (
        'All markers face the sensor, at the same distances and with the same edge. Full-HD '
        'pictures with a field of view of ±25° across are computed from a pinhole, a blur, '
        f'and the photons of {figures["lux"]:.0f} lux, before a background of dead leaves. '
        'The paper gives ±25° without an axis; were it the lower one, tags would have fewer pixels '
        'and a shorter reach. AprilTag 3 runs with its defaults and searching in all pixels, zbar '
        'as it is. '
        'A reading of the LiDAR takes a whole packet of '
        f'{figures["packet_s"]:.1f} s, a picture 33 ms, and the paper compares these two. To be '
        f'fair to the camera, the table also asks whether it reads one of the {many} pictures '
        'that it takes in that time, if shaking hands make their places independent. A camera '
        'in any case gives a near tag after one picture, '
        f'{many} times earlier, with its full orientation, and all tags of the picture at once.'
    )


def _table(figures: dict[str, Any]) -> str:
    sizes = list(figures['reading'][figures['methods'][0]]['reach_m'])
    ranges_m = (1.0, 2.0, 2.4)
    heads = [
        'reader',
        *(f'{size}: {LEVEL:.0%} to' for size in sizes),
        *(f'{size}, within {figures["packet_s"]:.1f} s' for size in sizes),
        *(f'median error at {range_m:.1f} m' for range_m in ranges_m),
        'processor time per second',
        'wrong IDs',
    ]
    lines = ['| ' + ' | '.join(heads) + ' |', '|' + '---|' * len(heads)]
    for name in (*figures['methods'], *figures['readers']):
        reading = figures['reading'][name]
        cells = [
            name,
            *(metres(reach_m(figures, name, size)) for size in sizes),
            *(metres(reach_m(figures, name, size, 'packet_time')) for size in sizes),
            *(text(error_mm(figures, name, at, 'median'), '{:.1f} mm') for at in ranges_m),
            f'{reading["cpu_ms"]:.0f} ms',
            str(reading['wrong']),
        ]
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def _beside_tags(figures: dict[str, Any]) -> str:
    default = figures['methods'][0]
    sentences = []
    for size, paper in (('3 cm', '2.6 m against 2.4 m'), ('1 cm', '1.3 m against 0.9 m')):
        ours, tag, fine = (
            reach_m(figures, name, size) for name in (default, APRILTAG, APRILTAG_FINE)
        )
        sentences.append(
            f'At {size} `{default}` reads to {metres(ours)}, AprilTag to {metres(tag)}, and '
            f'to {metres(fine)} when it searches in all pixels (paper: {paper}).'
        )
    gain, fine_gain = (
        more(reach_m(figures, default, '1 cm'), reach_m(figures, name, '1 cm'))
        for name in (APRILTAG, APRILTAG_FINE)
    )
    sentences.append(
        f'The 44 % that the paper gains over the tag of 1 cm are {text(gain, "{:+.0%}")} here, '
        f'and {text(fine_gain, "{:+.0%}")} over the better setting.'
    )
    for name in (APRILTAG, APRILTAG_FINE):
        beaten = [
            f'{100 * place["size_m"]:.0f} cm at {place["range_m"]:.1f} m'
            for place in figures['places']
            if place['results'][default]['read']['high'] < place['results'][name]['read']['low']
        ]
        if beaten:
            sentences.append(
                f'One picture gives {name} more than a whole packet gives `{default}`, beyond '
                f"doubt, for {', '.join(beaten)}: in these pictures the paper's lead is gone there."
            )
    sentences.append(_plateau(figures))
    return ' '.join(sentences)


def _plateau(figures: dict[str, Any]) -> str:
    """Say what the paper's method reads where its signal is strong."""
    near = [
        place['results']['paper']['read']
        for place in figures['places']
        if place['size_m'] == 0.03 and place['range_m'] <= 2.0
    ]
    share = sum(row['hits'] for row in near) / sum(row['trials'] for row in near)
    halves = ' and '.join(
        metres(reach_m(figures, 'paper', size, 'single_half'))
        for size in figures['reading']['paper']['reach_m']
    )
    return (
        f'`paper` reads {share:.0%} of the packets of 3 cm up to 2 m, as its preamble is '
        'sometimes found two bits late at any strength, so where it falls below '
        f'{LEVEL:.0%} is left to chance; half are read to {halves}.'
    )


def _tags_of_the_paper(figures: dict[str, Any]) -> str:
    default = figures['methods'][0]
    tag_mm, ours_mm = (error_mm(figures, name, 2.4, 'median') for name in (APRILTAG, default))
    largest_mm = error_mm(figures, APRILTAG, 2.4, 'largest')
    at = figures['sweep']['range_m']
    curved = figures['gamma']['results'][APRILTAG]['error_mm']
    form = '{:.1f} mm'
    return (
        "Our pictures are kinder to the tags than the paper's phones: perfectly calibrated, in "
        "focus, still, and neither smoothed nor compressed. AprilTag's error of range at 2.4 m "
        f'is {text(tag_mm, form)} in the median (paper: 11.7 mm) and {text(largest_mm, form)} '
        f'at most (paper: 156.2 mm). `{default}` has {text(ours_mm, form)}, '
        f'{text(more(ours_mm, tag_mm), "{:+.0%}")} where the paper says -85 %, at no '
        'named distance. Our simulated LiDAR has the random deviation of a VL53L8CX and no bias; '
        'a real one has both. Levels are proportional to light here. With the gamma of '
        f'{figures["gamma"]["gamma"]:.1f} that usual pictures have, blurred edges move to the '
        f"dark side, and the tag's median error at {at:.0f} m becomes "
        f'{text(curved and curved["median"], form)} instead of '
        f'{text(error_mm(figures, APRILTAG, at, "median"), form)}.'
    )


def _light(figures: dict[str, Any]) -> str:
    at = figures['sweep']
    where = f'{100 * at["size_m"]:.0f} cm at {at["range_m"]:.0f} m'
    ends = []
    for name in figures['readers']:
        dark, glare = (
            falls_below(
                LEVEL,
                [row[key] for row in figures[rows]],
                [row['results'][name]['read']['rate'] for row in figures[rows]],
            )
            for rows, key in (('lights', 'lux'), ('glares', 'veil'))
        )
        ends.append(
            f'{name} down to {text(dark, "{:.3g} lux")} and up to a veil of {text(glare, "{:.2g}")}'
        )
    return (
        f'In the dark and under glare (a veil of light, in shares of white paper), {LEVEL:.0%} of '
        f'the markers of {where} are read by ' + '; '.join(ends) + '. Indoor light is 100 to 500 '
        "lux, and a full moon gives about 0.2; motion blur and a phone's noise reduction would "
        'end this earlier. The LiDAR brings its own light. Its simulation does not know visible '
        'light at all, so its line over illuminance is no measurement; what light at its own '
        '940 nm does is in the experiment `ambient`.'
    )


def _cost(figures: dict[str, Any]) -> str:
    default = figures['methods'][0]
    reading = figures['reading']
    own_ms, quiet_ms = reading[default]['cpu_ms'], reading[default]['quiet_cpu_ms']
    ratios = ', '.join(
        f'{name} {reading[name]["cpu_ms"] / own_ms:.0f} times' for name in figures['readers']
    )
    return (
        f'A second of watching costs `{default}` {own_ms:.0f} ms with three markers talking and '
        f'{quiet_ms:.0f} ms with none, on one core of the machine of this run. '
        + (f'Of the former, the cost of 30 pictures is {ratios} as much. ' if ratios else '')
        + 'That of visual markers depends on the edges in the picture, and dead leaves have many; '
        'reading fewer pictures a second would cut it in proportion. In '
        f'{figures["whole_pictures"]} whole pictures, '
        f'{figures["wrong_in_whole_pictures"]} IDs were read that were not there.'
    )
