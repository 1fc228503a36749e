# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From where a marker wakes, and what a threshold so near the noise is worth.

Levels and ranges follow from `retrolidar_ros.marker.wakeup`. How far single readings of the noise
scatter about their level the paper does not tell. So that is computed over the bandwidth of the
noise: a root mean square over a look of T seconds of white Gaussian noise of a bandwidth B has
2·B·T independent samples.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.report.charts import new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.marker.battery import CELL_MAH, PROTOTYPE, life_h
from retrolidar_ros.marker.wakeup import (
    GUARD_V,
    LARGEST_ANGLE_RAD,
    LIGHT_AT_1_M_V,
    LOOK_EVERY_S,
    LOOK_S,
    NOISE_V,
    REACH_M,
    THRESHOLD_V,
    WAKING_S,
    needed_light_v,
    voltage_v,
    wakeup_range_m,
)
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

TITLE = 'Waking the marker'
SOURCE = 'paper §3.3, §6.5, Tab. 5, Fig. 12'

WITH_LIDAR_V = 32.413e-3  # paper Tab. 5, both filters; we take it as measured at 1 m
NARROW_TESTED_M = 3.75  # the paper's, with a VL53L4CX (§6.5)
_NARROW_FIELD_RAD = math.radians(18)
# The transimpedance amplifier is one pole of 2 MΩ and 3 pF (paper §5); as much white noise passes
# it as a sharp filter of π/2 times its corner.
CORNER_HZ = 1 / (2 * math.pi * 2e6 * 3e-12)
AMPLIFIER_HZ = math.pi / 2 * CORNER_HZ
_BANDWIDTHS_HZ = (AMPLIFIER_HZ, *(float(hertz) for hertz in np.geomspace(1e4, 3e6, 16)))
_LOOKS_AN_HOUR = 3600 / LOOK_EVERY_S
_READINGS, _QUICK_READINGS = 1_000_000, 200_000
_ANGLES_DEG = (0, 30, 50)
_RANGES_M = np.linspace(0.6, 4.0, 69)
_COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7')


def noise_readings_v(
    bandwidth_hz: float, noise_v: float, count: int, rng: np.random.Generator
) -> Floats:
    """Return what looks at white noise alone read.

    Parameters
    ----------
    bandwidth_hz : float
        Of the noise [Hz].
    noise_v : float
        Its level [V].
    count : int
        How many looks.
    rng : numpy.random.Generator
        Where they come from.

    Returns
    -------
    array, shape (count,)
        Root mean squares over one look each [V].
    """
    samples = 2 * bandwidth_hz * LOOK_S
    readings: Floats = noise_v * np.sqrt(rng.chisquare(samples, count) / samples)
    return readings


def _scatter(bandwidth_hz: float, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what the guard is worth at a bandwidth, and what guard one false wake-up needs."""
    noise_v = NOISE_V['indoors']
    readings = noise_readings_v(bandwidth_hz, noise_v, count, rng)
    threshold_v = float(np.quantile(readings, 1 - 1 / _LOOKS_AN_HOUR))
    return {
        'bandwidth_hz': bandwidth_hz,
        'spread_v': float(readings.std()),
        'false_per_hour': _LOOKS_AN_HOUR * float((readings >= THRESHOLD_V).mean()),
        'safe_guard_v': threshold_v - noise_v,
        'safe_range_m': wakeup_range_m(threshold_v),
    }


def _bounded(range_m: float) -> float | None:
    return range_m if math.isfinite(range_m) else None


def _narrow_gain() -> float:
    """Return how much brighter the light is if it fills 18° instead of this sensor's square."""
    edge = ZoneGrid().pitch * ZoneGrid().columns / 2  # tangent
    square = 4 * math.asin(edge**2 / (1 + edge**2))
    cone = 2 * math.pi * (1 - math.cos(_NARROW_FIELD_RAD / 2))
    return square / cone


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return voltages, ranges, and how often noise wakes the marker; JSON null = no bound."""
    count = _QUICK_READINGS if quick else _READINGS
    gain = _narrow_gain()
    return {
        'threshold_v': THRESHOLD_V,
        'surroundings': [
            {
                'name': name,
                'noise_v': noise_v,
                'at_1_m_v': float(voltage_v(np.array(1.0), noise_v=noise_v)),
                'range_m': _bounded(wakeup_range_m(THRESHOLD_V, noise_v)),
                'own_threshold_range_m': wakeup_range_m(noise_v + GUARD_V, noise_v),
            }
            for name, noise_v in NOISE_V.items()
        ],
        'at_angle': [
            {
                'angle_deg': angle,
                'range_m': wakeup_range_m(angle_rad=math.radians(angle)),
                'voltage_v': voltage_v(_RANGES_M, math.radians(angle)).tolist(),
            }
            for angle in _ANGLES_DEG
        ],
        'ranges_m': _RANGES_M.tolist(),
        # If voltages added, the guard alone would be the light at the reach.
        'voltages_added_at_1_m_v': NOISE_V['indoors'] + GUARD_V * REACH_M**2,
        'cosine_alone_deg_at_1_m': math.degrees(
            math.acos(needed_light_v(THRESHOLD_V, NOISE_V['indoors']) / LIGHT_AT_1_M_V)
        ),
        'narrow': {
            'gain': gain,
            'range_m': REACH_M * math.sqrt(gain),
            'gain_for_tested': (NARROW_TESTED_M / REACH_M) ** 2,
        },
        'awake_life_h': life_h(CELL_MAH, PROTOTYPE.active),
        'waking_s': WAKING_S,
        'scatter': [_scatter(hertz, count, rng) for hertz in _BANDWIDTHS_HZ],
        'readings': count,
    }


def _mv(volts: float) -> str:
    return f'{1e3 * volts:.1f} mV'


def _over_bandwidth(figures: dict[str, Any]) -> list[dict[str, Any]]:
    return sorted(figures['scatter'], key=lambda row: float(row['bandwidth_hz']))


def _wide_enough_hz(figures: dict[str, Any]) -> float:
    """Return from which bandwidth on the paper's guard lets noise wake once an hour at most."""
    rows = _over_bandwidth(figures)[::-1]  # the guard must rise
    guards = np.log([row['safe_guard_v'] for row in rows])
    bandwidths = np.log([row['bandwidth_hz'] for row in rows])
    return float(np.exp(np.interp(math.log(GUARD_V), guards, bandwidths)))


def summarise(figures: dict[str, Any]) -> str:
    """Return tables of the figures."""
    lines = ['             noise   lit from 1 m   wakes to   with noise + 1 mV as threshold']
    for row in figures['surroundings']:
        reach = 'always awake' if row['range_m'] is None else f'{row["range_m"]:.2f} m'
        lines.append(
            f'{row["name"]:10} {_mv(row["noise_v"])}  {_mv(row["at_1_m_v"]):>13} '
            f'{reach:>12} {row["own_threshold_range_m"]:10.2f} m'
        )
    lines.append('bandwidth of the noise   false wake-ups an hour   guard for one   it wakes to')
    lines += [
        f'{1e-3 * row["bandwidth_hz"]:18.1f} kHz {row["false_per_hour"]:20.1f} '
        f'{_mv(row["safe_guard_v"]):>19} {row["safe_range_m"]:9.2f} m'
        for row in _over_bandwidth(figures)
    ]
    return '\n'.join(lines)


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw voltages over distance, ranges over the threshold, and the guard over bandwidth."""
    figure, ((over_range, over_threshold), (woken, reach)) = new_chart(2, 2, 13, 9.5)
    for row, colour in zip(figures['at_angle'], _COLOURS, strict=False):
        over_range.plot(
            figures['ranges_m'],
            [1e3 * volts for volts in row['voltage_v']],
            color=colour,
            label=f'model, indoors, {row["angle_deg"]}°',
        )
    over_range.plot(1.0, 1e3 * WITH_LIDAR_V, 'kD', label="paper's Tab. 5, taken as at 1 m")
    over_range.axhline(1e3 * THRESHOLD_V, color='k', linewidth=1, label='threshold')
    outdoors = 1e3 * NOISE_V['outdoors']
    over_range.axhline(outdoors, color='k', linestyle=':', label='noise outdoors, no light at all')
    over_range.set_ylim(10, 70)
    over_range.set_xlabel('distance [m]')
    over_range.set_ylabel('photodiode behind both filters [mV rms]')
    over_range.set_title('voltage', fontsize=11)
    over_range.legend(fontsize=9)

    thresholds_v = np.linspace(NOISE_V['dark'], 45e-3, 800)
    for name, colour in zip(('dark', 'indoors', 'outdoors'), _COLOURS, strict=False):
        noise_v = NOISE_V[name]
        above = thresholds_v[thresholds_v > noise_v]
        over_threshold.plot(
            1e3 * above,
            [wakeup_range_m(float(volts), noise_v) for volts in above],
            color=colour,
            label=name,
        )
    over_threshold.axvline(1e3 * THRESHOLD_V, color='k', linewidth=1, label="the paper's threshold")
    over_threshold.set_ylim(0, 4)
    over_threshold.set_xlabel('threshold [mV rms]')
    over_threshold.set_ylabel('wakes to [m]')
    over_threshold.set_title('range; left of a curve the marker is always awake', fontsize=11)
    over_threshold.legend(fontsize=9)

    rows = _over_bandwidth(figures)
    bandwidths_khz = [1e-3 * row['bandwidth_hz'] for row in rows]
    woken.plot(bandwidths_khz, [row['false_per_hour'] for row in rows], 'o-', color=_COLOURS[0])
    woken.axhline(1.0, color='k', linewidth=0.8)
    woken.set_yscale('symlog', linthresh=1)
    woken.set_ylim(0, _LOOKS_AN_HOUR)
    woken.set_ylabel('false wake-ups an hour, indoors')
    woken.set_title("the paper's guard of 1 mV", fontsize=11)
    reach.plot(bandwidths_khz, [row['safe_range_m'] for row in rows], 'o-', color=_COLOURS[0])
    reach.axhline(REACH_M, color='k', linewidth=0.8, label="the paper's reach")
    reach.set_ylim(0, 2.6)
    reach.set_ylabel('wakes to [m]')
    reach.set_title('a guard that noise passes once an hour', fontsize=11)
    for axes in (woken, reach):
        axes.axvline(1e-3 * AMPLIFIER_HZ, color='k', linestyle='--', label='first amplifier')
        axes.set_xscale('log')
        axes.set_xlabel('bandwidth of the noise, assumed white [kHz]')
        axes.legend(fontsize=9, loc='lower right' if axes is reach else 'upper right')
    figure.savefig(path)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Return the paper's values beside the model's."""
    by_name = {row['name']: row for row in figures['surroundings']}
    amplifier = figures['scatter'][0]
    return [
        Claim(
            'wake-up range indoors (the model is fitted to it)',
            f'{REACH_M:g} m',
            default=f'{by_name["indoors"]["range_m"]:.2f} m',
        ),
        Claim(
            'voltage at 1 m, powers added',
            _mv(WITH_LIDAR_V),
            default=_mv(by_name['indoors']['at_1_m_v']),
        ),
        Claim(
            'voltage at 1 m, voltages added',
            _mv(WITH_LIDAR_V),
            default=_mv(figures['voltages_added_at_1_m_v']),
        ),
        Claim('wake-up range in the dark', default=f'{by_name["dark"]["range_m"]:.2f} m'),
        Claim("wake-up outdoors with the paper's threshold", default='always awake'),
        Claim(
            'wake-up range outdoors, threshold at its noise + 1 mV',
            default=f'{by_name["outdoors"]["own_threshold_range_m"]:.2f} m',
        ),
        Claim(
            'wake-up range with a VL53L4CX',
            f'{NARROW_TESTED_M:g} m, tested',
            default=f'at most {figures["narrow"]["range_m"]:.1f} m',
        ),
        Claim(
            "false wake-ups an hour indoors, if all noise has the first amplifier's bandwidth",
            default=f'{amplifier["false_per_hour"]:.0f}',
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Return what the figures show."""
    by_name = {row['name']: row for row in figures['surroundings']}
    indoors, dark, outdoors = (by_name[name] for name in ('indoors', 'dark', 'outdoors'))
    excess, dark_excess = (row['at_1_m_v'] / WITH_LIDAR_V - 1 for row in (indoors, dark))
    amplifier = figures['scatter'][0]
    narrow = figures['narrow']
    guard = f'{1e3 * GUARD_V:g} mV'
    return f"""\
One number is fitted: the strength of the light, such that the paper's threshold (its indoor \
noise and {guard}) is passed to {REACH_M:g} m. If light and noise add in power, it predicts \
{_mv(indoors['at_1_m_v'])} at 1 m, {100 * excess:.0f} % above the {_mv(WITH_LIDAR_V)} of Tab. 5 \
({100 * dark_excess:.0f} % above in the dark; the table tells neither distance nor light, and we \
take the paper's usual 1 m). If voltages added, it would be \
{_mv(figures['voltages_added_at_1_m_v'])}. So the model adds powers. The cosine alone would let \
the marker wake up to {figures['cosine_alone_deg_at_1_m']:.0f}° at 1 m; the paper's limit of \
{math.degrees(LARGEST_ANGLE_RAD):.0f}° is taken as it is. Waking takes up to \
{1e3 * figures['waking_s']:.1f} ms.

**A threshold for indoors is one for indoors only.** Outdoors the noise alone, \
{_mv(outdoors['noise_v'])}, is above {_mv(figures['threshold_v'])}: the marker never sleeps, and \
its cell lasts {figures['awake_life_h']:.0f} h. A threshold {guard} above the outdoor noise wakes \
it to {outdoors['own_threshold_range_m']:.2f} m there. In the dark there is less noise to help \
the light over the threshold, and the range is {dark['range_m']:.2f} m instead of \
{indoors['range_m']:.2f} m.

**The guard of {guard} is thin.** The paper tells levels, and not how far single readings \
scatter. White noise of the bandwidth of its first amplifier ({1e-3 * CORNER_HZ:.1f} kHz corner, \
as much noise as {1e-3 * AMPLIFIER_HZ:.1f} kHz) has a spread of {_mv(amplifier['spread_v'])} in a \
look of {1e3 * LOOK_S:g} ms, and would wake the marker {amplifier['false_per_hour']:.0f} times an \
hour; one false wake-up an hour would need a guard of {_mv(amplifier['safe_guard_v'])}, with \
which the marker wakes to {amplifier['safe_range_m']:.2f} m. Only from about \
{1e-6 * _wide_enough_hz(figures):.1f} MHz on is {guard} enough. Noise of the amplifiers \
themselves may be as wide as that, so this is a question to the circuit and no refutation.

A VL53L4CX sends the same power into 18°. Were all of it spread evenly over the field of view, \
here a square and there a cone, the light would be {narrow['gain']:.1f} times as strong and wake \
the marker to {narrow['range_m']:.1f} m: an upper bound. The {NARROW_TESTED_M:g} m that the paper \
tested need {narrow['gain_for_tested']:.1f} times."""
