# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The link: signal against distance and area, and what longer integration gains."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evaluation.report.charts import look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import WALL_SIGNAL, marker_in_each_zone
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Link budget'
SOURCE = 'paper §4, Fig. 5a–c'
PAPER_EXPONENT, PAPER_DISTANCE_R2, PAPER_AREA_R2 = -3.8, 0.9826, 0.9853
_RANGES_M = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0)
_FAR_M = 1.5  # from here on the paper fits its power law
_EDGES_M = (0.010, 0.015, 0.020, 0.025, 0.030, 0.040)
_AT_M = 1.0
_FRAMES, _QUICK_FRAMES = 2000, 400
_INTEGRATED = (1, 2, 4, 8, 16)  # frames
NEVER_S = 1e9


def fit_line(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float]:
    """Return slope, intercept and R² of the least-squares line through points."""
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    slope, intercept = np.polyfit(x, y, 1)
    left = y - (slope * x + intercept)
    return float(slope), float(intercept), float(1 - left @ left / ((y - y.mean()) ** 2).sum())


def bright_signal(
    range_m: float, size_m: float, frames: int, rng: np.random.Generator, *, wall: bool = True
) -> Floats:
    """Return the signal of bright markers [kcps/SPAD], shape (frames, zones)."""
    scene = marker_in_each_zone(range_m, rng, start_s=(NEVER_S, NEVER_S), size_m=size_m)
    if not wall:
        scene = replace(scene, surfaces=())
    signal: Floats = Simulation(scene, rng).advance(frames).signal.astype(np.float64)
    return signal


def snr_db(signal: Floats, integrated: int) -> float:
    """Return mean over deviation of a signal, as 20 log10, when frames are averaged."""
    whole = len(signal) // integrated * integrated
    averaged = signal[:whole].reshape(-1, integrated, signal.shape[1]).mean(axis=1)
    return float(20 * np.log10(averaged.mean() / averaged.std(axis=0, ddof=1).mean()))


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return signals over distance and area with their fits, and SNR over integration time."""
    frames = _QUICK_FRAMES if quick else _FRAMES
    over_range = [
        {
            'range_m': range_m,
            'signal': float(bright_signal(range_m, 0.03, frames, rng, wall=False).mean()),
        }
        for range_m in _RANGES_M
    ]
    over_area = [
        {
            'area_cm2': round(1e4 * edge_m**2, 4),
            'signal': float(bright_signal(_AT_M, edge_m, frames, rng).mean()),
        }
        for edge_m in _EDGES_M
    ]
    still = bright_signal(2.0, 0.03, 4 * frames, rng)
    over_time = [
        {'frames': count, 'time_s': round(0.021 * count, 4), 'snr_db': snr_db(still, count)}
        for count in _INTEGRATED
    ]
    far = [row for row in over_range if row['range_m'] >= _FAR_M]
    exponent, _, distance_r2 = fit_line(
        [math.log(row['range_m']) for row in far], [math.log(row['signal']) for row in far]
    )
    per_cm2, offset, area_r2 = fit_line(
        [row['area_cm2'] for row in over_area], [row['signal'] for row in over_area]
    )
    per_decade, _, time_r2 = fit_line(
        [math.log10(row['frames']) for row in over_time], [row['snr_db'] for row in over_time]
    )
    return {
        'distance': {
            'points': over_range,
            'from_m': _FAR_M,
            'exponent': exponent,
            'r2': distance_r2,
        },
        'area': {
            'points': over_area,
            'range_m': _AT_M,
            'per_cm2': per_cm2,
            'offset': offset,
            'r2': area_r2,
        },
        'time': {'points': over_time, 'db_per_decade': per_decade, 'r2': time_r2},
        'wall_signal': WALL_SIGNAL,
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return the fits, and the signals that they are of."""
    distance, area, time = figures['distance'], figures['area'], figures['time']
    signals = '  '.join(
        f'{row["signal"]:.1f} at {row["range_m"]:g} m' for row in distance['points']
    )
    fits = {
        'distance': f'R^{distance["exponent"]:.2f} from {distance["from_m"]:g} m on',
        'area': f'{area["per_cm2"]:.1f} kcps/SPAD a cm² + {area["offset"]:.1f}',
        'integration': f'{time["db_per_decade"]:.2f} dB for ten times',
    }
    lines = [
        f'{name:12} {fit}, R² {one["r2"]:.4f}'
        for (name, fit), one in zip(fits.items(), (distance, area, time), strict=True)
    ]
    lines.append(f'3 cm         {signals}')
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the fits beside the paper's."""
    distance, area, time = figures['distance'], figures['area'], figures['time']
    return [
        Claim(
            'signal over distance beyond 1.5 m',
            f'R^{PAPER_EXPONENT:g}, R² {PAPER_DISTANCE_R2:g}',
            default=f'R^{distance["exponent"]:.2f}, R² {distance["r2"]:.4f}',
        ),
        Claim(
            'signal over area: R² of a line',
            f'{PAPER_AREA_R2:g}',
            default=f'{area["r2"]:.4f}',
        ),
        Claim(
            'SNR for k times the integration',
            '10 log10 k dB',
            default=f'{time["db_per_decade"]:.2f} log10 k dB',
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say what of this is put in, and what is left out."""
    area = figures['area']
    return (
        "This checks the simulation, not the world: the exponent is the paper's own and is put "
        'in, so are the proportion to area and the whiteness of the noise, and the fits are of '
        'simulated frames. Nearer than 1.5 m the paper sees deviations, which it puts '
        'down to the narrow retroreflected beam and the receiver beside the laser. The simulation '
        'does not have them, so a marker close to the sensor is likely too bright here. '
        f'The offset of {area["offset"]:.1f} kcps/SPAD is the wall of '
        f'{figures["wall_signal"]:g} kcps/SPAD behind the markers; in the paper it is the tripod.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw signal over distance and area, and SNR over integration time."""
    figure, ((far, wide, long),) = new_chart(1, 3, 15, 4.8)
    how = {**look('joint'), 'markersize': 6}
    distance, area, time = figures['distance'], figures['area'], figures['time']
    ranges = [row['range_m'] for row in distance['points']]
    signals = [row['signal'] for row in distance['points']]
    far.loglog(ranges, signals, linestyle='', **how)
    fitted = signals[-1] * (np.array(ranges) / ranges[-1]) ** distance['exponent']
    far.loglog(ranges, fitted, color='0.4', label=f'R^{distance["exponent"]:.2f}')
    far.set_xticks([0.5, 1, 2, 3], ['0.5', '1', '2', '3'])
    far.minorticks_off()
    far.set_xlabel('distance [m]')
    far.set_ylabel('signal of a bright marker of 3 cm [kcps/SPAD]')
    areas = [row['area_cm2'] for row in area['points']]
    wide.plot(areas, [row['signal'] for row in area['points']], linestyle='', **how)
    line = area['per_cm2'] * np.array([0, *areas]) + area['offset']
    wide.plot([0, *areas], line, color='0.4', label=f'line, R² {area["r2"]:.4f}')
    wide.set_xlabel('area [cm²]')
    wide.set_ylabel(f'signal at {area["range_m"]:g} m, with the wall [kcps/SPAD]')
    times_ms = [1e3 * row['time_s'] for row in time['points']]
    snrs_db = [row['snr_db'] for row in time['points']]
    long.semilogx(times_ms, snrs_db, linestyle='', **how)
    law = snrs_db[0] + 10 * np.log10(np.array(times_ms) / times_ms[0])
    long.semilogx(times_ms, law, color='0.4', label='10 log10 k')
    long.set_xticks(times_ms, [f'{time_ms:.0f}' for time_ms in times_ms])
    long.minorticks_off()
    long.set_xlabel('integration time [ms]')
    long.set_ylabel('signal over noise [dB]')
    for axis, title in zip((far, wide, long), ('distance', 'area', 'integration'), strict=True):
        axis.set_title(title, fontsize=12)
        axis.legend(fontsize=10)
    figure.savefig(path)
