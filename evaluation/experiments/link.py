# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The link: signal against distance and area, and what longer integration gains.

This checks the simulation, not the world: exponent, proportion to area and whiteness of the noise
are put in.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evaluation.bench.reference_scene import marker_in_each_zone
from evaluation.report.chart_style import OTHERS, label, legend_under, line, look, new_chart
from evaluation.report.claims import Claims, model
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Link budget'
MESSAGE = 'The simulated link follows the laws put in'
_RANGES_M = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.25, 2.5, 2.75, 3.0)
_FAR_M = 1.5  # from here on the paper fits its power law
_EDGES_M = (0.010, 0.015, 0.020, 0.025, 0.030, 0.040)
_AT_M = 1.0
_INTEGRATED = (1, 2, 4, 8, 16)  # frames
NEVER_S = 1e9


def board_signal(range_m: float) -> float:
    """Return what a bare board of 9 cm² sends back [kcps/SPAD]: 4 at 1.4 m (paper §3.2)."""
    return float(4.0 * (range_m / 1.4) ** -3.8)


def fit_line(x: ArrayLike, y: ArrayLike) -> tuple[float, float, float]:
    """Return slope, intercept and R² of the least-squares line through points."""
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    slope, intercept = np.polyfit(x, y, 1)
    return float(slope), float(intercept), float(np.corrcoef(x, y)[0, 1] ** 2)


def bright_signal(
    range_m: float, size_m: float, frames: int, rng: np.random.Generator, *, wall: bool = True
) -> Floats:
    """Return the signal of bright markers [kcps/SPAD], shape (frames, zones)."""
    scene = marker_in_each_zone(range_m, rng, start_s=(NEVER_S, NEVER_S), size_m=size_m)
    if not wall:
        scene = replace(scene, surfaces=())
    return Simulation(scene, rng).advance(frames).signal.astype(np.float64)


def integrated_db(signal: Floats, integrated: int) -> float:
    """Return mean over deviation of a signal, as 20 log10, when frames are averaged."""
    whole = len(signal) // integrated * integrated
    averaged = signal[:whole].reshape(-1, integrated, signal.shape[1]).mean(axis=1)
    return float(20 * np.log10(averaged.mean() / averaged.std(axis=0, ddof=1).mean()))


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return signals over distance and area with their fits, and SNR over integration time."""
    frames = 400 if quick else 2000
    signals = [
        float(bright_signal(range_m, 0.03, frames, rng, wall=False).mean()) for range_m in _RANGES_M
    ]
    areas = [1e4 * edge_m**2 for edge_m in _EDGES_M]
    of_areas = [float(bright_signal(_AT_M, edge, frames, rng).mean()) for edge in _EDGES_M]
    still = bright_signal(2.0, 0.03, 4 * frames, rng)
    snrs_db = [integrated_db(still, count) for count in _INTEGRATED]
    far = _RANGES_M.index(_FAR_M)
    exponent, _, _ = fit_line(np.log(_RANGES_M[far:]), np.log(signals[far:]))
    per_cm2, offset, area_r2 = fit_line(areas, of_areas)
    return {
        'ranges_m': list(_RANGES_M),
        'signals': signals,
        'exponent': exponent,
        'areas_cm2': areas,
        'of_areas': of_areas,
        'per_cm2': per_cm2,
        'offset': offset,
        'area_r2': area_r2,
        'times_ms': [1e3 * SENSOR.period_s * count for count in _INTEGRATED],
        'snrs_db': snrs_db,
        'db_per_decade': fit_line(np.log10(_INTEGRATED), snrs_db)[0],
    }


def claims(figures: dict[str, Any]) -> Claims:
    """Return what integration buys; the other laws are put in."""
    return {'time': model(f'{figures["db_per_decade"]:.2f} log10 k dB')}


def draw(figures: dict[str, Any]) -> Any:
    """Draw signal over distance and area, and SNR over integration time."""
    figure, (far, wide, long) = new_chart(3, 2, 8, MESSAGE)
    how = look('joint') | {'linestyle': '', 'markersize': 7}
    ranges_m, signals = figures['ranges_m'], figures['signals']
    far.plot(ranges_m, signals, **how, label='marker of 3 cm')
    fitted = signals[-1] * (np.array(ranges_m) / ranges_m[-1]) ** figures['exponent']
    far.plot(ranges_m, fitted, color='0.4', label=f'R^{figures["exponent"]:.2f}')
    boards = [board_signal(range_m) for range_m in ranges_m]
    far.plot(ranges_m, boards, **line('--', OTHERS[1]), label='bare board of 9 cm²')
    far.axhline(WALL_SIGNAL, **line(':', '0.4'), label='what is around it')
    log: dict[str, Any] = {'xscale': 'log', 'yscale': 'log'}
    label(far, 'distance [m]', 'signal [kcps/SPAD]', xticks=(0.5, 1, 2, 3), **log)
    areas = np.array([0, *figures['areas_cm2']])
    wide.plot(figures['areas_cm2'], figures['of_areas'], **how, label='marker at 1 m, with wall')
    fitted = figures['per_cm2'] * areas + figures['offset']
    wide.plot(areas, fitted, color='0.4', label=f'line, R² {figures["area_r2"]:.4f}')
    label(wide, 'area [cm²]', 'signal [kcps/SPAD]')
    times_ms = figures['times_ms']
    long.plot(times_ms, figures['snrs_db'], **how, label='marker at 2 m')
    law = figures['snrs_db'][0] + 10 * np.log10(np.array(times_ms) / times_ms[0])
    long.plot(times_ms, law, color='0.4', label='10 log10 k')
    x, y = 'integration time [ms]', 'signal over noise [dB]'
    label(long, x, y, xscale='log', xticks=np.rint(times_ms))
    for axis in (far, wide, long):
        legend_under(axis)
    return figure
