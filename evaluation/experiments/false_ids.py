# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""False IDs of the default as shipped, in scenes without a marker in which nothing blinks.

A budget of one in ten hours takes many hours of frames to check, so this counts longer than `roc`.
"""

from typing import Any

import numpy as np

from evaluation.bench.disturbances import FAMILY
from evaluation.bench.rates import Frequency, frequency
from evaluation.experiments.roc import counted
from evaluation.report.chart_style import label, look, new_chart
from retrolidar_ros.detector.methods import USUAL_FALSE_IDS_PER_HOUR

TITLE = 'False IDs, hour by hour'
HOURS = {member.name: 3.0 for member in FAMILY if not member.blinks} | {'hands': 9.0}
_QUICK_SHARE = 0.0005
ALL = 'all'


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return false IDs by member."""
    seed, share = int(rng.integers(2**32)), _QUICK_SHARE if quick else 1.0
    return {
        'members': {
            one.name: counted({}, one, share * HOURS[one.name], seed)
            for one in FAMILY
            if one.name in HOURS
        }
    }


def total(figures: dict[str, Any]) -> Frequency:
    """Return the false IDs of all members."""
    members = figures['members'].values()
    return frequency(sum(one['events'] for one in members), sum(one['hours'] for one in members))


def draw(figures: dict[str, Any]) -> Any:
    """Draw false IDs an hour with their confidence, a row for each member."""
    rows = {ALL: total(figures), **dict([*figures['members'].items()][::-1])}
    one, budget = rows[ALL], USUAL_FALSE_IDS_PER_HOUR
    counted = f'{one["events"]} false {"ID" if one["events"] == 1 else "IDs"}'
    rate = f'at most {one["high"]:.2g} an hour; the budget is {budget:g}'
    title = f'{counted} in {one["hours"]:g} hours without a marker: {rate}'
    figure, (axis,) = new_chart(1, 1, 1.7 + 0.27 * len(rows), title)
    for place, (name, one) in enumerate(rows.items()):
        how = look('joint') | {'linewidth': 4 if name == ALL else 2}
        axis.plot([one['low'], one['high']], [place, place], color=how['color'], alpha=0.4)
        axis.plot(one['per_hour'], place, **how)
        beside = {'va': 'center', 'transform': axis.get_yaxis_transform()}
        axis.text(1.01, place, f'{one["events"]} in {one["hours"]:g} h', fontsize=9.5, **beside)
    axis.axvline(budget, color='0.3', linestyle='--')
    axis.set_yticks(range(len(rows)), rows)
    label(axis, 'false IDs an hour, with 95 % confidence; dashed: the budget', xlim=(0, None))
    return figure
