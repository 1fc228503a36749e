# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long the cell of a marker lasts, and under which reading the paper's two years hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.report.charts import new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.marker.battery import (
    CELL_MAH,
    PACKET_S,
    PROTOTYPE,
    Currents,
    active_share,
    drawn,
    life_h,
)

TITLE = 'Power and battery life'
SOURCE = 'paper §5, Tab. 2'

OPTIMISED_MA = 0.1  # "approximately 100 µA" (paper §5)
BUSY_SHARE = 1e-3  # active, of all time: Tab. 2's "< 0.1 %"
_DAY_H = 24.0
_YEAR_H = 365.25 * _DAY_H
_PROMISED_H = 2 * _YEAR_H
_TWO_MONTHS_H = _YEAR_H / 6
_CHEAP_LOOKS = replace(PROTOTYPE, detection=OPTIMISED_MA)
_ALL_OPTIMISED = replace(_CHEAP_LOOKS, active=OPTIMISED_MA)
_PARTS = {
    'prototype': PROTOTYPE,
    '100 µA in detection': _CHEAP_LOOKS,
    '100 µA in detection and active': _ALL_OPTIMISED,
}
_QUERIES = tuple(float(queries) for queries in np.geomspace(0.01, 2000, 54))
_COLOURS = ('#0072b2', '#d55e00', '#009e73')


def _life(name: str, currents: Currents, active: float) -> dict[str, Any]:
    means = drawn(active, currents)
    return {
        'name': name,
        'drawn_ma': means._asdict(),
        'total_ma': means.total,
        'life_h': life_h(CELL_MAH, means.total),
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return lives of the cell; nothing is random, and nothing takes long."""
    hourly = active_share(1)
    most_ma = CELL_MAH / _PROMISED_H
    silent = drawn(0.0, _CHEAP_LOOKS).total
    asleep = drawn(hourly, _CHEAP_LOOKS)
    return {
        'once_an_hour': [_life(name, parts, hourly) for name, parts in _PARTS.items()],
        'busy': [_life(name, parts, BUSY_SHARE) for name, parts in _PARTS.items()],
        'mean_of_100_ua_h': life_h(CELL_MAH, OPTIMISED_MA),
        'two_years': {
            'mean_ma': most_ma,
            'active_ma': (most_ma - asleep.sleep - asleep.detection) / hourly,
            'queries_per_hour': (most_ma - silent) / (drawn(1.0).active - silent) / hourly,
        },
        'over_queries': {
            name: [_life(name, parts, active_share(queries)) for queries in _QUERIES]
            for name, parts in _PARTS.items()
        },
        'queries_per_hour': list(_QUERIES),
    }


def _days(hours: float) -> str:
    return f'{hours / _DAY_H:.0f} days' if hours < _YEAR_H else f'{hours / _YEAR_H:.2f} years'


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = ['parts                            sleep  detection  active   total [µA]   life']
    for title, key in (('a packet an hour', 'once_an_hour'), ('0.1 % active', 'busy')):
        lines.append(title)
        for row in figures[key]:
            parts = [1e3 * part for part in row['drawn_ma'].values()]
            lines.append(
                f'  {row["name"]:31}{parts[0]:5.2f}{parts[1]:11.2f}{parts[2]:8.2f}'
                f'{1e3 * row["total_ma"]:13.2f}   {_days(row["life_h"])}'
            )
    lines.append(f'100 µA in the mean: {_days(figures["mean_of_100_ua_h"])}')
    return '\n'.join(lines)


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw the life over queries, and what part each mode has in the prototype's current."""
    figure, ((life, parts),) = new_chart(1, 2, 13, 5)
    queries = figures['queries_per_hour']
    for (name, rows), colour in zip(figures['over_queries'].items(), _COLOURS, strict=True):
        life.plot(queries, [row['life_h'] / _DAY_H for row in rows], color=colour, label=name)
    for hours, words in ((_TWO_MONTHS_H, 'two months'), (_PROMISED_H, 'two years')):
        life.axhline(hours / _DAY_H, color='0.4', linewidth=0.8)
        life.text(0.012, hours / _DAY_H, words, va='top', fontsize=9)
    life.axvline(1.0, color='0.4', linewidth=0.8, linestyle=':', label='once an hour')
    life.set_yscale('log')
    life.set_ylabel(f'life of {CELL_MAH:g} mAh [days]')
    life.set_title('battery life', fontsize=11)
    life.legend(fontsize=9, loc='lower left')
    rows = figures['over_queries']['prototype']
    modes = list(rows[0]['drawn_ma'])
    parts.stackplot(
        queries,
        [[100 * row['drawn_ma'][mode] / row['total_ma'] for row in rows] for mode in modes],
        labels=modes,
        colors=_COLOURS,
        alpha=0.75,
    )
    parts.set_ylim(0, 100)
    parts.set_ylabel('part of the charge [%]')
    parts.set_title('what the prototype spends it on', fontsize=11)
    parts.legend(fontsize=9, loc='center left')
    for axes in (life, parts):
        axes.set_xscale('log')
        axes.set_xlim(queries[0], queries[-1])
        axes.set_xlabel('queries an hour, a packet each')
    figure.savefig(path)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Return the paper's lives beside ours."""
    prototype, looks, everything = figures['once_an_hour']
    return [
        Claim(
            'life of the prototype, a packet an hour',
            'two months',
            default=_days(prototype['life_h']),
        ),
        Claim(
            f'life of the prototype, {BUSY_SHARE:.1%} active',
            'two months',
            default=_days(figures['busy'][0]['life_h']),
        ),
        Claim(
            'life with 100 µA in the mean',
            'over two years',
            default=_days(figures['mean_of_100_ua_h']),
        ),
        Claim(
            'life with 100 µA in detection, a packet an hour',
            'over two years',
            default=_days(looks['life_h']),
        ),
        Claim(
            'life with 100 µA in detection and active, a packet an hour',
            'over two years',
            default=_days(everything['life_h']),
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Return what the figures show."""
    prototype, looks, everything = figures['once_an_hour']
    busy = figures['busy']
    bound = figures['two_years']
    looking = prototype['drawn_ma']['detection'] / prototype['total_ma']
    return f"""\
**Two months hold.** One packet of {PACKET_S:g} s an hour draws {1e3 * prototype['total_ma']:.1f} \
µA in the mean, {_days(prototype['life_h'])} of {CELL_MAH:g} mAh; active for {BUSY_SHARE:.1%} of \
the time, as Tab. 2 has it for example, {_days(busy[0]['life_h'])}. {looking:.0%} of the hourly \
charge goes into looking for a sensor.

**Two years hold only if the active current falls, too.** They allow {1e3 * bound['mean_ma']:.1f} \
µA in the mean. The paper's "approximately 100 µA" cannot be the mean: that would last \
{_days(figures['mean_of_100_ua_h'])}, less than the prototype. As the current in detection mode, \
with {PROTOTYPE.active:g} mA while active, it gives {_days(looks['life_h'])} at a packet an hour, \
and {_days(busy[1]['life_h'])} at {BUSY_SHARE:.1%} active. Two years then need fewer than \
{bound['queries_per_hour']:.2f} queries an hour, or an active current below \
{bound['active_ma']:.1f} mA. If 100 µA is both, the cell would last \
{_days(everything['life_h'])}. The paper names a microcontroller of low power as well, so this \
may be meant; it gives no active current for it. Self-discharge is left out, which over such \
years counts."""
