# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How steadily a hovering drone is read, the harder it flies (paper §7.2)."""

from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.places import place_error, read_live, rms
from evaluation.bench.rates import Rate, rate
from evaluation.report.chart_style import draw_shares, label, legend_below, line, look, new_chart
from evaluation.report.claims import BOTH_CLAIMED, Claims, Table, as_text, claim_of, percent, shares
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Occlusion, Wander
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Recording

TITLE = 'Drone'
PAPER_RATE, PAPER_RANGE_MM = 0.91, 10.0
WINDOWS_S = (2.0, 5.0, 10.0)
DURATION_S, QUICK_DURATION_S = 200.0, 30.0
_ACROSS_M, _ALONG_M = 0.12, 0.01  # the paper's drift of more than 20 cm
_SPEEDS_M_S = (0.06, 0.1, 0.2, 0.3, 0.45, 0.6)
_HIDDEN = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
_BLADE_S = 0.5  # a blade passes as often
_STILL_M_S, _STILL_HIDDEN = 0.06, 0.04  # the flight of the shipped scene, about


def flight(speed_m_s: float, hidden: float) -> Scene:
    """Return a drone that drifts at a mean speed, hidden by its rotor for a share of the time."""
    scene = load_scene('drone')
    (marker,) = scene.markers
    # The mean speed of a sine is 4 amplitudes a period.
    wander = Wander(_ACROSS_M, _ALONG_M, 4 * _ACROSS_M / speed_m_s)
    occlusion = Occlusion(_BLADE_S, hidden * _BLADE_S) if hidden else None
    return replace(scene, markers=(replace(marker, wander=wander, occlusion=occlusion),))


def alive(known_s: list[float], lasting_s: float, window_s: float) -> Rate:
    """Return in how many of the whole windows of a length [s] a reading came."""
    windows = int(lasting_s / window_s)
    return rate(len({int(one / window_s) for one in known_s} & set(range(windows))), windows)


def _followed(recording: Recording, marker: Marker) -> dict[str, Any]:
    """Return in how many frames the drone is followed, and by how much its range is off then."""
    detector = create_detector('joint', recording.grid)
    assert isinstance(detector, LikelihoodDetector)
    tracks = []
    for frame in recording:
        detector.update(frame)
        tracks += [one for one in detector.follow(frame) if one.id == marker.id]
    truths_m = position_at(marker, 1e-9 * np.array([one.stamp_ns for one in tracks]))
    errors_m = [
        place_error(one.place, truth_m).range_m
        for one, truth_m in zip(tracks, truths_m, strict=True)
    ]
    off_m = rms(errors_m)
    return {
        'followed': rate(len(tracks), len(recording)),
        'range_mm': None if off_m is None else round(1e3 * off_m, 2),
    }


def _flown(speed_m_s: float, hidden: float, duration_s: float, rng: Any) -> dict[str, Any]:
    scene = flight(speed_m_s, hidden)
    (marker,) = scene.markers
    recording = Simulation(scene, rng).run(duration_s)
    lasting_s = 1e-9 * int(recording.stamp_ns[-1] - recording.stamp_ns[0])
    row: dict[str, Any] = {'speed_m_s': speed_m_s, 'hidden': hidden}
    for method in METHODS:
        readings = list(read_live(method, recording))
        own = [one for one in readings if one.detection.id == marker.id]
        places = [one.detection for one in own]
        truths_m = position_at(marker, 1e-9 * np.array([one.stamp_ns for one in places]))
        errors_mm = [
            round(1e3 * place_error(one.place, truth_m).range_m, 2)
            for one, truth_m in zip(places, truths_m, strict=True)
        ]
        row[method] = {
            'alive': [alive([one.known_s for one in own], lasting_s, at) for at in WINDOWS_S],
            'wrong_ids': len(readings) - len(own),
            'range_mm': errors_mm,
        }
    return row | {'tracks': _followed(recording, marker)}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return heartbeats and errors over the speed, and over what the rotor hides."""
    duration_s, stride = (QUICK_DURATION_S, 3) if quick else (DURATION_S, 1)
    flights = {
        'faster': [(speed, _STILL_HIDDEN) for speed in _SPEEDS_M_S[::stride]],
        'darker': [(_STILL_M_S, hidden) for hidden in _HIDDEN[::stride]],
    }
    return {
        name: [_flown(*one, duration_s, rng) for one in flown] for name, flown in flights.items()
    }


def table(figures: dict[str, Any]) -> Table:
    """Return windows with a reading and errors, by how the drone flies."""
    windows = [f'{method}: windows of 2, 5, 10 s with a reading' for method in METHODS]
    errors = [f'{method}: rms error of range, wrong IDs' for method in METHODS]
    rows = [['flight', *windows, *errors, 'followed, rms error of range']]
    for row in [*figures['faster'], *figures['darker']]:
        both = [row[method] for method in METHODS]
        cells = [', '.join(map(percent, one['alive'])) for one in both]
        rms_mm = [rms(one['range_mm']) for one in both]
        cells += [
            f'{as_text(off, "mm", 1)}, {one["wrong_ids"]}'
            for off, one in zip(rms_mm, both, strict=True)
        ]
        tracks = row['tracks']
        cells.append(f'{percent(tracks["followed"])}, {as_text(tracks["range_mm"], "mm", 1)}')
        rows.append([f'{row["speed_m_s"]:g} m/s, hidden {row["hidden"]:.0%} of the time', *cells])
    return rows


def claims(figures: dict[str, Any]) -> Claims:
    """Set heartbeats and errors beside the paper's."""
    darker, falls = figures['darker'], []
    for method in BOTH_CLAIMED:
        lost = [row['hidden'] for row in darker if row[method]['alive'][-1]['rate'] < PAPER_RATE]
        falls.append(f'hidden {lost[0]:.0%}' if lost else f'over {darker[-1]["hidden"]:.0%}')
    both = [figures['faster'][0][method] for method in BOTH_CLAIMED]
    good = [
        float(np.mean(np.abs(row['range_mm']) < PAPER_RANGE_MM)) if row['range_mm'] else 0.0
        for row in both
    ]
    alive = [row['alive'][-1]['rate'] for row in both]
    return {
        'alive': shares(alive, alive[1] >= PAPER_RATE),
        'falls': claim_of(falls),
        'range': shares(good, good[1] > 0.95),
    }


def _message(figures: dict[str, Any]) -> str:
    steady = [row for row in figures['faster'] if row['joint']['alive'][-1]['rate'] >= PAPER_RATE]
    hidden = [row for row in figures['darker'] if row['joint']['alive'][-1]['rate'] >= PAPER_RATE]
    speed_m_s = max((row['speed_m_s'] for row in steady), default=0.0)
    share = max((row['hidden'] for row in hidden), default=0.0)
    return (
        f'A drone is read to {speed_m_s:g} m/s, or with a rotor that hides {share:.0%} of the time'
    )


def draw(figures: dict[str, Any]) -> Any:
    """Draw windows with a reading, and frames in which it is followed, over speed and shadow."""
    figure, panels = new_chart(2, 2, 4.4, _message(figures))
    axes = (
        ('faster', 'speed_m_s', 1, 'mean speed of the drift [m/s]'),
        ('darker', 'hidden', 100, 'hidden by the rotor [% of the time]'),
    )
    for axis, (name, key, scale, x) in zip(panels, axes, strict=True):
        rows = figures[name]
        places = [scale * row[key] for row in rows]
        for method in METHODS:
            draw_shares(axis, places, [row[method]['alive'][-1] for row in rows], **look(method))
        draw_shares(axis, places, [row['tracks']['followed'] for row in rows], **look('tracks'))
        axis.axhline(100 * PAPER_RATE, **line('-.'), linewidth=1)
        y = 'windows of 10 s, or frames [%]' if axis is panels[0] else ''
        label(axis, x, y, percent=True)
    others = {'frames followed (tracks)': look('tracks'), "the paper's own, 10 s": line('-.')}
    legend_below(figure, METHODS, others)
    return figure
