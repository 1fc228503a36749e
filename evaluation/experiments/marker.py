# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The marker in closed form: what wakes it, and how long its cell lasts (paper §5, §6.5).

Levels, ranges and currents follow from `retrolidar_ros.marker.power`. How far single readings of
the noise scatter about their level the paper does not say: a root mean square over a look of T
seconds of white Gaussian noise of a bandwidth B has 2·B·T independent samples, so its square is
distributed as chi-squared.
"""

import math
from dataclasses import replace
from statistics import NormalDist
from typing import Any

import numpy as np

from evaluation.report.chart_style import OTHERS, draw_level, label, legend_beside, new_chart
from evaluation.report.claims import Claims, as_text, model
from retrolidar_ros.marker import power
from retrolidar_ros.marker.power import CELL_MAH, PROTOTYPE, active_share, drawn
from retrolidar_ros.sensor.frame import ZoneGrid

TITLE = 'The marker: waking and battery'
WITH_LIDAR_V = 32.413e-3  # paper Tab. 5, both filters; we take it as measured at 1 m
_NARROW_FIELD_RAD = math.radians(18)
# The transimpedance amplifier is one pole of 2 MΩ and 3 pF (paper §5); as much white noise passes
# it as a sharp filter of π/2 times its corner.
AMPLIFIER_HZ = math.pi / 2 / (2 * math.pi * 2e6 * 3e-12)
_LOOKS_AN_HOUR = 3600 / power.LOOK_EVERY_S
_BANDWIDTHS_HZ = np.geomspace(1e4, 3e6, 40)
_RANGES_M = np.linspace(0.6, 4.0, 69)
_ANGLES_DEG = (0, 30, 50)
OPTIMISED_MA = 0.1  # the paper's "approximately 100 µA" (§5)
_CHEAP_LOOKS = replace(PROTOTYPE, detection=OPTIMISED_MA)
PARTS = {
    'prototype': PROTOTYPE,
    '100 µA in detection': _CHEAP_LOOKS,
    '100 µA in detection and active': replace(_CHEAP_LOOKS, active=OPTIMISED_MA),
}
_QUERIES = np.geomspace(0.01, 1000, 51)
_DAY_H, _YEAR_H = 24.0, 365.25 * 24.0


def guard_v(bandwidth_hz: float, chance: float, noise_v: float) -> float:
    """Return by how much single readings of noise exceed its level with a chance [V].

    The quantile of chi-squared is that of Wilson and Hilferty (1931).
    """
    samples = 2 * bandwidth_hz * power.LOOK_S
    normal = NormalDist().inv_cdf(1 - chance)
    raised = (1 - 2 / (9 * samples) + normal * math.sqrt(2 / (9 * samples))) ** 3
    return noise_v * (math.sqrt(raised) - 1)


def false_per_hour(bandwidth_hz: float, threshold_v: float, noise_v: float) -> float:
    """Return how often noise alone passes a threshold in an hour."""
    samples = 2 * bandwidth_hz * power.LOOK_S
    root = ((threshold_v / noise_v) ** 2) ** (1 / 3)
    normal = (root - 1 + 2 / (9 * samples)) / math.sqrt(2 / (9 * samples))
    return _LOOKS_AN_HOUR * 0.5 * math.erfc(normal / math.sqrt(2))


def narrow_gain() -> float:
    """Return how much brighter the light is if it fills 18° instead of this sensor's square."""
    edge = ZoneGrid().pitch * ZoneGrid().columns / 2  # tangent
    square = 4 * math.asin(edge**2 / (1 + edge**2))
    return square / (2 * math.pi * (1 - math.cos(_NARROW_FIELD_RAD / 2)))


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return voltages, ranges, guards and lives; nothing is random."""
    indoors = power.NOISE_V['indoors']
    hourly, shares = active_share(1), [active_share(one) for one in _QUERIES.tolist()]
    guards = [guard_v(hertz, 1 / _LOOKS_AN_HOUR, indoors) for hertz in _BANDWIDTHS_HZ.tolist()]
    max_ma = CELL_MAH / (2 * _YEAR_H)
    asleep = drawn(hourly, _CHEAP_LOOKS)
    reaches = {
        name: power.wakeup_range_m(power.THRESHOLD_V, noise)
        for name, noise in power.NOISE_V.items()
    }
    return {
        'wakes_to_m': {name: at if math.isfinite(at) else None for name, at in reaches.items()},
        'at_1_m_v': float(power.voltage_v(np.array(1.0))),
        # If voltages added, the guard alone would be the light at the reach.
        'voltages_added_at_1_m_v': indoors + power.GUARD_V * power.REACH_M**2,
        'narrow_m': power.REACH_M * math.sqrt(narrow_gain()),
        'amplifier': {
            'false_per_hour': false_per_hour(AMPLIFIER_HZ, power.THRESHOLD_V, indoors),
            'guard_v': guard_v(AMPLIFIER_HZ, 1 / _LOOKS_AN_HOUR, indoors),
        },
        'bandwidths_hz': _BANDWIDTHS_HZ.tolist(),
        'safe_m': [power.wakeup_range_m(indoors + guard) for guard in guards],
        'once_an_hour_h': {
            name: CELL_MAH / drawn(hourly, parts).total for name, parts in PARTS.items()
        },
        'awake_h': CELL_MAH / PROTOTYPE.active,
        'mean_of_100_ua_h': CELL_MAH / OPTIMISED_MA,
        'two_years_active_ma': (max_ma - asleep.sleep - asleep.detection) / hourly,
        'queries_per_hour': _QUERIES.tolist(),
        'over_queries_h': {
            name: [CELL_MAH / drawn(share, parts).total for share in shares]
            for name, parts in PARTS.items()
        },
    }


def _days(hours: float) -> str:
    return f'{hours / _DAY_H:.0f} days' if hours < _YEAR_H else f'{hours / _YEAR_H:.1f} years'


def _mv(volts: float) -> str:
    return f'{1e3 * volts:.1f} mV'


def claims(figures: dict[str, Any]) -> Claims:
    """Return the model's values."""
    lives = figures['once_an_hour_h']
    return {
        'two-months': model(_days(lives['prototype'])),
        'two-years': model(_days(figures['mean_of_100_ua_h'])),
        'cheap-looks': model(_days(lives['100 µA in detection'])),
        'active': model(f'{figures["two_years_active_ma"]:.1f} mA'),
        'powers': model(_mv(figures['at_1_m_v'])),
        'voltages': model(_mv(figures['voltages_added_at_1_m_v'])),
        'outdoors': model(f'always awake, {figures["awake_h"]:.0f} h'),
        'guard': model(_mv(figures['amplifier']['guard_v'])),
        'woken': model(f'{figures["amplifier"]["false_per_hour"]:.0f}'),
        'narrow': model(f'at most {figures["narrow_m"]:.1f} m'),
    }


def draw(figures: dict[str, Any]) -> Any:
    """Draw voltages over distance, reach over the noise's bandwidth, and lives over queries."""
    wakes = as_text(figures['wakes_to_m']['indoors'])
    # Where the noise that passes the first amplifier is all there is.
    hourly_m = float(np.interp(AMPLIFIER_HZ, figures['bandwidths_hz'], figures['safe_m']))
    lives = _days(figures['once_an_hour_h']['prototype'])
    title = (
        f"With the paper's guard a marker wakes to {wakes} indoors, with one false wake-up an hour "
        f'to {hourly_m:.1f} m; with a packet an hour its battery lasts {lives}'
    )
    figure, (volts, reach, life) = new_chart(3, 2, 7.4, title)
    for angle, colour in zip(_ANGLES_DEG, OTHERS, strict=False):
        course = 1e3 * power.voltage_v(_RANGES_M, math.radians(angle))
        volts.plot(_RANGES_M, course, color=colour, label=f'{angle}°')
    volts.plot(1.0, 1e3 * WITH_LIDAR_V, 'kD')
    volts.annotate("paper's Tab. 5", (1.0, 1e3 * WITH_LIDAR_V), (1.2, 40), fontsize=10)
    draw_level(volts, 1e3 * power.THRESHOLD_V, 'threshold')
    draw_level(volts, 1e3 * power.NOISE_V['outdoors'], 'noise outdoors', linestyle=':')
    volts.legend(title='indoors, turned by', frameon=False, fontsize=10.5)
    label(volts, 'distance [m]', 'behind both filters [mV rms]', ylim=(10, 70))
    hertz = 1e-3 * np.array(figures['bandwidths_hz'])
    reach.plot(hertz, figures['safe_m'], color=OTHERS[0])
    draw_level(reach, power.REACH_M, "the paper's reach, guard 1 mV", 0.75)
    reach.axvline(1e-3 * AMPLIFIER_HZ, color='k', linewidth=1, linestyle='--')
    reach.text(1.15e-3 * AMPLIFIER_HZ, 0.3, 'passes the first amplifier', fontsize=10)
    x, title = 'bandwidth of white noise [kHz]', 'one false wake-up an hour'
    label(reach, x, 'wakes to [m]', title, xscale='log', ylim=(0, 3))
    for (name, hours), colour in zip(figures['over_queries_h'].items(), OTHERS, strict=False):
        life.plot(figures['queries_per_hour'], np.array(hours) / _DAY_H, color=colour, label=name)
    for hours, words in ((_YEAR_H / 6, 'two months'), (2 * _YEAR_H, 'two years')):
        draw_level(life, hours / _DAY_H, words)
    x, y = 'queries an hour, a packet each', f'life of {CELL_MAH:g} mAh [days]'
    label(life, x, y, xscale='log', yscale='log')
    legend_beside(life)
    return figure
