# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identification against false IDs: each method at every setting of its threshold.

False IDs are counted before every member of the family of scenes without a marker
(`evaluation.bench.disturbances`), and before markers that are silent. The default is run with each
budget; of `paper` one run with the lowest threshold serves for all, as what it reads has its
likelihood.
"""

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.disturbances import FAMILY, Member, source_blocks, white
from evaluation.bench.judging import Options, judged, read_of
from evaluation.bench.rates import Frequency, frequency, rate
from evaluation.bench.recordings import record_at
from evaluation.report.chart_style import label, legend_below, line, look, new_chart
from evaluation.report.claims import BOTH_CLAIMED, Claim, Claims, Table, per_hour, three_digits
from retrolidar_ros.detector import METHODS, Detection, create_detector
from retrolidar_ros.detector.methods import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.detector.paper_detector import LIKELIHOOD_THRESHOLD
from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.marker.dictionary import choose_ids
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording

TITLE = 'Identification against false IDs'
KNOBS = {'joint': 'false_ids_per_hour', 'paper': 'likelihood_threshold'}
SHIPPED = {'joint': USUAL_FALSE_IDS_PER_HOUR, 'paper': LIKELIHOOD_THRESHOLD}
BUDGETS_H = {1e4: 0.006, 1e3: 0.02, 1e2: 0.05}
"""Sensor-hours of each member, by the budget; with a lax one, short times suffice."""
THRESHOLDS = (0.03, 0.05, 0.08, 0.12, 0.16, 0.2, 0.25, 0.3, LIKELIHOOD_THRESHOLD, 0.5, 0.65, 0.8)
SHIPPED_H = {'white': 2.0, 'other bit periods': 0.06, 'another preamble': 0.06}
"""Sensor-hours of the default as shipped; `false-ids` counts more of them."""
BUSY_H, BLINKING_H, PAPER_H, SILENT_H, WHITE_H = 0.08, 0.02, 0.03, 0.2, 1.0
_BLINKING_SHARE = 0.1  # of the hours of other members: false IDs are frequent there
WHITE_BUDGET, REGISTERED = 10.0, (3, 30, 300)
"""Budget, and numbers of registered IDs, for `WHITE_H` of white noise alone."""
GROUPS = {
    'bare wall': ('white',),
    'drifting signals': tuple(one.name for one in FAMILY if 'walk' in one.name),
    'targets that come and go, hands': ('come and go', 'come together', 'hands'),
    'things that blink': tuple(one.name for one in FAMILY if one.blinks),
}  # members of the family by the panel that shows them
STILL = 'all but things that blink'
_RANGES_M = (2.6, 3.0)
_FACES = (None, 'white')
_QUICK_SHARE = 0.02
_SILENT = partial(source_blocks, partial(white, signals=(30.0, 30.0)))


def watch(detector: Any, blocks: Iterable[Recording]) -> list[Detection]:
    """Return what a detector reads of a stream without a marker."""
    return [one for block in blocks for one in detector.update_all(block)]


def _detections(options: Options, member: Member, hours: float, seed: int) -> list[Detection]:
    detector = create_detector(grid=SENSOR.grid, **options)
    # The same noise for every method and setting.
    rng = np.random.default_rng([seed, FAMILY.index(member)])
    return watch(detector, member.blocks(3600 * hours, rng))


def counted(options: Options, member: Member, hours: float, seed: int) -> Frequency:
    """Return the false IDs of the default before a member."""
    return frequency(len(_detections({'method': 'joint', **options}, member, hours, seed)), hours)


def _by_budget(seed: int, share: float, budget: float) -> dict[str, Frequency]:
    found = {}
    for member in FAMILY:
        if budget in BUDGETS_H:
            hours = share * BUDGETS_H[budget] * (_BLINKING_SHARE if member.blinks else 1.0)
        else:
            hours = share * SHIPPED_H.get(member.name, BLINKING_H if member.blinks else BUSY_H)
        found[member.name] = counted({KNOBS['joint']: budget}, member, hours, seed)
    return found


def _by_threshold(seed: int, share: float) -> dict[float, dict[str, Frequency]]:
    hours, options = share * PAPER_H, {'method': 'paper', KNOBS['paper']: THRESHOLDS[0]}
    likelihoods = {
        member.name: [one.likelihood for one in _detections(options, member, hours, seed)]
        for member in FAMILY
    }
    return {
        least: {
            name: frequency(sum(one >= least for one in rows), hours)
            for name, rows in likelihoods.items()
        }
        for least in THRESHOLDS
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return identification of lone packets and false IDs an hour over the methods' knobs."""
    share = _QUICK_SHARE if quick else 1.0
    sent = {f'{at:g}': [record_at(at, rng) for _ in range(1 if quick else 6)] for at in _RANGES_M}
    seed = int(rng.integers(2**32))
    budgets = {one: _by_budget(seed, share, one) for one in (*BUDGETS_H, SHIPPED['joint'])}
    methods: dict[str, list[dict[str, Any]]] = {'joint': [], 'paper': []}
    for method, found in {'joint': budgets, 'paper': _by_threshold(seed, share)}.items():
        for knob, members in found.items():
            options = {'method': method, KNOBS[method]: knob}
            read = {at: read_of([judged(one, options) for one in of]) for at, of in sent.items()}
            methods[method].append({'knob': knob, 'members': members, 'read': read})
    settings: dict[str, Options] = {
        f'budget of {WHITE_BUDGET:g} an hour': {KNOBS['joint']: WHITE_BUDGET},
        **{f'{n} IDs registered': {'registered_ids': choose_ids(n)[0]} for n in REGISTERED},
    }
    before_white = {
        name: counted(one, FAMILY[0], share * WHITE_H, seed) for name, one in settings.items()
    }
    return {'methods': methods, 'before_white': before_white, 'silent': _silent(seed, share)}


def _silent(seed: int, share: float) -> dict[str, Any]:
    """Return what is read of markers that do not send: a wall that is as bright as they are."""
    hours = SILENT_H * share
    looks = max(1, round(hours * 3600 / PACKET_S)) * SENSOR.grid.zones
    found: dict[str, Any] = {'hours': hours}
    for method in METHODS:
        detector = create_detector(method, SENSOR.grid)
        read = watch(detector, _SILENT(3600 * hours, np.random.default_rng(seed)))
        found[method] = {
            'false_ids': len(read),
            'false preambles': rate(min(detector.counts.candidates, looks), looks),
        }
    return found


def shipped(figures: dict[str, Any], method: str) -> dict[str, Any]:
    """Return the point of a method as shipped."""
    points: list[dict[str, Any]] = figures['methods'][method]
    return next(point for point in points if point['knob'] == SHIPPED[method])


def grouped(point: dict[str, Any], group: str) -> Frequency:
    """Return the false IDs of the members of a group, or of all that do not blink."""
    names = GROUPS.get(group) or [one.name for one in FAMILY if not one.blinks]
    found = [point['members'][name] for name in names]
    return frequency(sum(one['events'] for one in found), sum(one['hours'] for one in found))


def table(figures: dict[str, Any]) -> Table:
    """Return false IDs an hour as shipped, with their exact 95 % confidence."""
    points = [shipped(figures, method) for method in METHODS]
    budget, *registered = map(per_hour, figures['before_white'].values())
    counts = ' / '.join(map(str, REGISTERED))
    return [
        ['false IDs an hour (95 %), as shipped', *METHODS],
        *(
            [name, *(per_hour(grouped(point, name)) for point in points)]
            for name in (*GROUPS, STILL)
        ),
        [f'bare wall, budget of {WHITE_BUDGET:g} an hour', budget, ''],
        [f'bare wall, {counts} IDs registered', ' / '.join(registered), ''],
    ]


def claims(figures: dict[str, Any]) -> Claims:
    """Return false preambles and false IDs, to compare with the paper's."""
    silent = figures['silent']
    counts = [silent[method]['false_ids'] for method in BOTH_CLAIMED]
    preambles = silent['paper']['false preambles']['rate']
    return {
        'silent': Claim(*(f'{n} in {silent["hours"]:.2g} h' for n in counts)),
        'preambles': Claim(f'{preambles:.2%}'),
    }


def _draw_group(axis: Any, figures: dict[str, Any], group: str) -> None:
    """Draw identification over the false IDs of a group, with the confidence of these."""
    for method in METHODS:
        for at, face in zip(_RANGES_M, _FACES, strict=True):
            how, points = look(method) | {'markerfacecolor': face}, figures['methods'][method]
            found = [grouped(point, group) for point in points]
            shares = [100 * point['read'][f'{at:g}']['right']['rate'] for point in points]
            # Without any false ID, only the upper bound is known.
            places = [one['per_hour'] or one['high'] for one in found]
            axis.plot(places, shares, **how | {'marker': ''})
            for one, place, share, point in zip(found, places, shares, points, strict=True):
                ends = [one['low'] or place / 4, one['high']]
                axis.plot(ends, [share, share], color=how['color'], alpha=0.35)
                own = {'markersize': 7} | ({} if one['events'] else {'marker': '<'})
                axis.plot(place, share, **how | own)
                if point['knob'] == SHIPPED[method]:
                    axis.plot(place, share, 'o', markersize=13, color='0.1', fillstyle='none')
        for end, words, side, ha in ((0, 'lax', 10, 'left'), (-1, 'strict', -10, 'right')):
            where = {'xytext': (side, 0), 'textcoords': 'offset points', 'va': 'center'}
            axis.annotate(words, (places[end], shares[end]), **where, ha=ha, color=how['color'])
    axis.margins(x=0.13)


def draw(figures: dict[str, Any]) -> Any:
    """Draw identification over false IDs, a panel for each kind of scene."""
    points = [shipped(figures, method) for method in METHODS]
    false = three_digits(grouped(points[1], STILL)['per_hour'])
    ours, paper = (f'{one["read"][f"{_RANGES_M[0]:g}"]["right"]["rate"]:.0%}' for one in points)
    title = (
        f"As shipped, the default reads {ours} of lone packets at {_RANGES_M[0]:g} m, the paper's "
        f'method {paper}, with {false} false IDs an hour'
    )
    figure, panels = new_chart(4, 2, 7.6, title)
    for axis, group in zip(panels, GROUPS, strict=True):
        _draw_group(axis, figures, group)
        x, y = 'false IDs an hour, 16 zones', 'lone packets identified [%]'
        label(axis, x, y, group, percent=True, xscale='log')
    ring = {'markersize': 13, 'fillstyle': 'none', 'linestyle': ''}
    others: dict[str, Any] = {
        f'at {at:g} m': line('-') | {'marker': 'o', 'markerfacecolor': face}
        for at, face in zip(_RANGES_M, _FACES, strict=True)
    }
    others['as shipped'] = line('', '0.1') | {'marker': 'o'} | ring
    others['none seen: upper bound'] = line('', '0.4') | {'marker': '<', 'markersize': 7}
    legend_below(figure, METHODS, others)
    return figure
