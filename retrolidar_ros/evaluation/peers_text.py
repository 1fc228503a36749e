# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the figures of LiDAR markers beside visual markers say, in words and tables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from retrolidar_ros.evaluation.charts import LEVEL
from retrolidar_ros.evaluation.claims import NOTHING, Claim
from retrolidar_ros.evaluation.statistics import falls_below
from retrolidar_ros.evaluation.visual_markers import APRILTAG, APRILTAG_FINE, QR


def summarise(figures: dict[str, Any]) -> str:
    """Return tables of the figures."""
    names = [*figures['methods'], *figures['readers']]
    wide = max(map(len, names)) + 2
    lines = [
        'right [%] in one packet or picture (within '
        + f'{figures["packet_s"]:.1f} s), error of range, median and 95 % [mm]'
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
    for rows, key, unit in ((figures['lights'], 'lux', 'lux'), (figures['glares'], 'veil', 'veil')):
        lines.append(f'right [%] over {unit}: ' + ', '.join(f'{row[key]:g}' for row in rows))
        lines += [
            f'  {name:{wide}}'
            + ' '.join(f'{100 * row["results"][name]["read"]["rate"]:4.0f}' for row in rows)
            for name in figures['readers']
        ]
    lines.append(f'{LEVEL:.0%} are read to; processor time per second of watching')
    for name in names:
        reading = figures['reading'][name]
        ends = ', '.join(
            f'{size} {_metres(reach["single"])}' for size, reach in reading['reach_m'].items()
        )
        quiet = reading['quiet_cpu_ms']
        lines.append(
            f'  {name:{wide}}{ends}; {reading["cpu_ms"]:.0f} ms'
            + ('' if quiet is None else f', {quiet:.0f} ms with no marker')
        )
    lines += [f'left out: {name}: {reason}' for name, reason in figures['missing'].items()]
    return '\n'.join(lines)


def _metres(reach_m: float | None) -> str:
    return 'nowhere' if reach_m is None else f'{reach_m:.2f} m'


def _reach(figures: dict[str, Any], name: str, size: str, time: str = 'single') -> float | None:
    """Return a reach [m], None for too little or a reader that is missing."""
    if name in figures['missing']:
        return None
    reach: float | None = figures['reading'][name]['reach_m'][size][time]
    return reach


def _error(figures: dict[str, Any], name: str, range_m: float, which: str) -> float | None:
    """Return an error of range [mm] at 3 cm, None if nothing was read there or it is missing."""
    for place in figures['places']:
        if (place['size_m'], place['range_m']) == (0.03, range_m) and name in place['results']:
            error = place['results'][name]['error_mm']
            return error and float(error[which])
    return None


def _text(value: float | None, form: str) -> str:
    return NOTHING if value is None else form.format(value)


def _more(value: float | None, than: float | None) -> float | None:
    ratio = _ratio(value, than)
    return None if ratio is None else ratio - 1


def _ratio(upper: float | None, lower: float | None) -> float | None:
    return None if upper is None or lower is None else upper / lower


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Return what the paper says of both kinds of marker beside what was measured here."""
    default = figures['methods'][0]

    def both(what: str, paper: str, form: str, value: Callable[[str], float | None]) -> Claim:
        return Claim(what, paper, *(_text(value(name), form) for name in ('paper', default)))

    def peer(what: str, paper: str, form: str, value: float | None) -> Claim:
        return Claim(what, paper, default=_text(value, form))

    def cost(name: str) -> float | None:
        return None if name in figures['missing'] else figures['reading'][name]['cpu_ms']

    return [
        both('LiDAR, 3 cm: read to', '2.6 m', '{:.2f} m', lambda n: _reach(figures, n, '3 cm')),
        both('LiDAR, 1 cm: read to', '1.3 m', '{:.2f} m', lambda n: _reach(figures, n, '1 cm')),
        peer(
            'AprilTag, 3 cm: read to',
            '2.2 to 2.4 m',
            '{:.2f} m',
            _reach(figures, APRILTAG, '3 cm'),
        ),
        peer(
            'AprilTag, 1 cm: read to',
            'below 0.9 m',
            '{:.2f} m',
            _reach(figures, APRILTAG, '1 cm'),
        ),
        peer('QR code, 3 cm: read to', 'below 1 m', '{:.2f} m', _reach(figures, QR, '3 cm')),
        peer(
            'AprilTag, 3 cm at 1 m: median error of range',
            'below 4 mm',
            '{:.1f} mm',
            _error(figures, APRILTAG, 1.0, 'median'),
        ),
        peer(
            'AprilTag, 3 cm at 2.4 m: median error of range',
            '11.7 mm',
            '{:.1f} mm',
            _error(figures, APRILTAG, 2.4, 'median'),
        ),
        peer(
            'AprilTag, 3 cm at 2.4 m: largest error of range',
            '156.2 mm',
            '{:.1f} mm',
            _error(figures, APRILTAG, 2.4, 'largest'),
        ),
        both(
            'LiDAR at 2.4 m: median error of range, of that of AprilTag',
            '-85 %',
            '{:+.0%}',
            lambda n: _more(
                _error(figures, n, 2.4, 'median'), _error(figures, APRILTAG, 2.4, 'median')
            ),
        ),
        both(
            'LiDAR, 1 cm: read farther than AprilTag',
            '+44 %',
            '{:+.0%}',
            lambda n: _more(_reach(figures, n, '1 cm'), _reach(figures, APRILTAG, '1 cm')),
        ),
        both(
            'LiDAR, 3 cm: reach over that of the QR code',
            '2.6',
            '{:.1f}',
            lambda n: _ratio(_reach(figures, n, '3 cm'), _reach(figures, QR, '3 cm')),
        ),
        both(
            'Processor time per second of watching: AprilTag over LiDAR',
            NOTHING,
            '{:.0f}',
            lambda n: _ratio(cost(APRILTAG), cost(n)),
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Return what the figures show, for the report."""
    parts = [_setting(figures), _table(figures)]
    if APRILTAG not in figures['missing']:
        parts += [_beside_tags(figures), _tags_of_the_paper(figures)]
    parts += [_light(figures), _cost(figures)]
    if figures['missing']:
        reasons = '; '.join(f'{name}: {reason}' for name, reason in figures['missing'].items())
        parts.append(f'Left out of this run: {reasons}.')
    return '\n\n'.join(parts)


def _setting(figures: dict[str, Any]) -> str:
    many = figures['pictures_of_a_packet']
    return (
        'All markers face the sensor, at the same distances and with the same edge. Full-HD '
        'pictures with a horizontal field of view of ±25° are computed from a pinhole, a blur, '
        f'and the photons of {figures["lux"]:.0f} lux, before a background of dead leaves; '
        'AprilTag 3 runs with its defaults and searching in all pixels, zbar as it is. '
        'A reading of the LiDAR takes a whole packet of '
        f'{figures["packet_s"]:.1f} s, a picture 33 ms, and the paper compares these two. To be '
        f'fair to the camera, the table also asks whether it reads one of the {many} pictures '
        'that it takes in that time, if shaking hands make their places independent. A camera '
        'in any case gives a near tag after one picture, forty times earlier, with its full '
        'orientation, and all tags of the picture at once.'
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
            *(_metres(_reach(figures, name, size)) for size in sizes),
            *(_metres(_reach(figures, name, size, 'packet_time')) for size in sizes),
            *(_text(_error(figures, name, at, 'median'), '{:.1f} mm') for at in ranges_m),
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
            _reach(figures, name, size) for name in (default, APRILTAG, APRILTAG_FINE)
        )
        sentences.append(
            f'At {size} `{default}` reads to {_metres(ours)}, AprilTag to {_metres(tag)}, and '
            f'to {_metres(fine)} when it searches in all pixels (paper: {paper}).'
        )
    gain = _more(_reach(figures, default, '1 cm'), _reach(figures, APRILTAG, '1 cm'))
    fine_gain = _more(_reach(figures, default, '1 cm'), _reach(figures, APRILTAG_FINE, '1 cm'))
    sentences.append(
        f'The 44 % that the paper gains over the tag of 1 cm are {_text(gain, "{:+.0%}")} here, '
        f'and {_text(fine_gain, "{:+.0%}")} over the better setting.'
    )
    beaten = [
        f'{100 * place["size_m"]:.0f} cm at {place["range_m"]:.1f} m'
        for place in figures['places']
        if place['results'][default]['read']['rate']
        < max(place['results'][name]['read']['rate'] for name in (APRILTAG, APRILTAG_FINE))
    ]
    if beaten:
        sentences.append(
            'One picture is read more often by one of the two settings than one packet is by '
            f'`{default}` for {", ".join(beaten)}.'
        )
    return ' '.join(sentences)


def _tags_of_the_paper(figures: dict[str, Any]) -> str:
    default = figures['methods'][0]
    tag_mm, ours_mm = (_error(figures, name, 2.4, 'median') for name in (APRILTAG, default))
    largest_mm = _error(figures, APRILTAG, 2.4, 'largest')
    at = figures['sweep']['range_m']
    curved = figures['gamma']['results'][APRILTAG]['error_mm']
    form = '{:.1f} mm'
    return (
        "Our pictures are kinder to the tags than the paper's phones: perfectly calibrated, in "
        "focus, still, and neither smoothed nor compressed. AprilTag's error of range at 2.4 m "
        f'is {_text(tag_mm, form)} in the median (paper: 11.7 mm) and {_text(largest_mm, form)} '
        f'at most (paper: 156.2 mm); `{default}` has {_text(ours_mm, form)}, which changes the '
        f'error by {_text(_more(ours_mm, tag_mm), "{:+.0%}")} where the paper says -85 %. Our '
        'simulated LiDAR has the random deviation of a VL53L8CX and no bias; a real one has '
        f'both. Levels are proportional to light here. With the gamma of '
        f'{figures["gamma"]["gamma"]:.1f} that usual pictures have, blurred edges move to the '
        f"dark side, and the tag's median error at {at:.0f} m becomes "
        f'{_text(curved and curved["median"], form)} instead of '
        f'{_text(_error(figures, APRILTAG, at, "median"), form)}.'
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
            f'{name} down to {_text(dark, "{:.2g} lux")} and up to a veil of '
            f'{_text(glare, "{:.2g}")}'
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
        f'{quiet_ms:.0f} ms with none, on one core of the machine of this run; of that of three '
        f'markers, {ratios} as much. A camera has some hundred thousand times more values a '
        "second to look at. The C libraries' cost depends on the edges in the picture, and dead "
        'leaves have many; reading fewer pictures a second would cut it in proportion. In '
        f'{figures["whole_pictures"]} whole pictures, '
        f'{figures["wrong_in_whole_pictures"]} IDs were read that were not there.'
    )
