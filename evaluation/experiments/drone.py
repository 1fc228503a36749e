# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How often a hovering drone is read, over its speed and what its rotor hides (paper §7.2)."""

from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.judging import watch
from evaluation.bench.places import median_mm, place_error
from evaluation.bench.rates import Rate, rate
from evaluation.report.chart_style import draw_shares, label, legend_below, line, look, new_chart
from evaluation.report.claims import BOTH_CLAIMED, Claim, Claims, as_text
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.detector.detection import Place
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Occlusion, Wander, load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Recording

TITLE = 'Drone'
PAPER_RATE, PAPER_RANGE_MM = 0.91, 10.0
WINDOW_S = 10.0
DURATION_S, QUICK_DURATION_S = 200.0, 30.0
_ACROSS_M, _ALONG_M = 0.12, 0.01  # the paper's drift of more than 20 cm
_SPEEDS_M_S = (0.06, 0.1, 0.2, 0.3, 0.45, 0.6)
_HIDDEN = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
_FOLLOWED = 0.02  # share of the frames, below which errors of tracks are not drawn
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


def alive(known_s: list[float], lasting_s: float) -> Rate:
    """Return in how many of the whole windows a reading came."""
    windows = int(lasting_s / WINDOW_S)
    return rate(len({int(one / WINDOW_S) for one in known_s} & set(range(windows))), windows)


def _watched(method: str, recording: Recording, marker: Marker) -> dict[str, Any]:
    """Return heartbeats, errors of range, and errors of the last known place at every frame.

    The latter are those of the newest packet, and of the track.
    """
    detector = create_detector(method, recording.grid)
    truths_m = position_at(marker, 1e-9 * recording.stamp_ns.astype(np.float64))
    newest: Place | None = None
    known_s, range_mm, off_m, followed_m = [], [], [], []
    for step, truth_m in zip(watch(detector, recording, follow=True), truths_m, strict=True):
        for one in step.detections:
            if one.id == marker.id:
                newest = one.place
                known_s.append(step.known_s)
                then_m = position_at(marker, np.array([1e-9 * one.stamp_ns]))[0]
                range_mm.append(round(1e3 * place_error(newest, then_m).range_m, 2))
        if newest is not None:
            off_m.append(place_error(newest, truth_m).position_m)
        tracks = [one for one in step.tracks if one.id == marker.id]
        followed_m += [place_error(one.place, truth_m).position_m for one in tracks]
    lasting_s = 1e-9 * int(recording.stamp_ns[-1] - recording.stamp_ns[0])
    return {
        'alive': alive(known_s, lasting_s),
        'range_mm': range_mm,
        'off_mm': median_mm(off_m),
        'followed': rate(len(followed_m), len(recording)),
        'followed_mm': median_mm(followed_m),
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return heartbeats and errors over the speed, and over what the rotor hides."""
    duration_s, stride = (QUICK_DURATION_S, 3) if quick else (DURATION_S, 1)
    flights = {
        'faster': [(speed, _STILL_HIDDEN) for speed in _SPEEDS_M_S[::stride]],
        'darker': [(_STILL_M_S, hidden) for hidden in _HIDDEN[::stride]],
    }
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in flights}
    for name, flown in flights.items():
        for speed_m_s, hidden in flown:
            scene = flight(speed_m_s, hidden)
            recording = Simulation(scene, rng).run(duration_s)
            watched = {method: _watched(method, recording, scene.markers[0]) for method in METHODS}
            found[name].append({'speed_m_s': speed_m_s, 'hidden': hidden, **watched})
    return found


def claims(figures: dict[str, Any]) -> Claims:
    """Return heartbeats and errors, to compare with the paper's."""
    darker, falls = figures['darker'], []
    windows = f'{darker[0]["joint"]["alive"]["trials"]} windows'
    for method in BOTH_CLAIMED:
        lost = [row['hidden'] for row in darker if row[method]['alive']['rate'] < PAPER_RATE]
        at = f'hidden {lost[0]:.0%}' if lost else f'over {darker[-1]["hidden"]:.0%}'
        falls.append(f'{at}, {windows} each')
    both = [figures['faster'][0][method] for method in BOTH_CLAIMED]
    good = [np.abs(row['range_mm'] or np.inf) < PAPER_RANGE_MM for row in both]
    return {
        'alive': Claim(*(f'{row["alive"]["rate"]:.0%} of {windows}' for row in both)),
        'falls': Claim(*falls),
        'range': Claim(*(f'{np.mean(one):.0%} of {len(one)}' for one in good)),
    }


def draw(figures: dict[str, Any]) -> Any:
    """Draw windows with a reading, frames followed, and errors of place, over speed and shadow."""
    row = max(figures['faster'], key=lambda one: one['joint']['off_mm'] or 0.0)
    packets, tracks = (as_text(row['joint'][name], 'mm', 0) for name in ('off_mm', 'followed_mm'))
    title = (
        f'At {row["speed_m_s"]:g} m/s, the worst speed, a drone is {packets} from its last packet, '
        f'and {tracks} from its track (medians)'
    )
    figure, panels = new_chart(6, 2, 9, title)
    axes = (
        ('faster', 'speed_m_s', 1, 'mean speed of the drift [m/s]'),
        ('darker', 'hidden', 100, 'hidden by the rotor [% of the time]'),
    )
    for column, (name, key, scale, x) in enumerate(axes):
        rows = figures[name]
        places = [scale * row[key] for row in rows]
        read, follow, off = panels[column::2]
        for method in METHODS:
            draw_shares(read, places, [row[method]['alive'] for row in rows], **look(method))
            off.plot(places, [row[method]['off_mm'] for row in rows], **look(method))
        joint = [row['joint'] for row in rows]
        draw_shares(follow, places, [one['followed'] for one in joint], **look('tracks'))
        # Of the few frames where hardly any is followed, an error says nothing.
        tracks_mm = [
            one['followed_mm'] if one['followed']['rate'] > _FOLLOWED else np.nan for one in joint
        ]
        off.plot(places, tracks_mm, **look('tracks'))
        read.axhline(100 * PAPER_RATE, **line('-.'), linewidth=1)
        label(read, y='' if column else f'windows of {WINDOW_S:g} s read [%]', percent=True)
        label(follow, y='' if column else 'frames followed [%]', percent=True)
        label(off, x, '' if column else 'error of place, median [mm]', ylim=(0, None))
    papers = {f"the paper's {100 * PAPER_RATE:.0f} %": line('-.')}
    legend_below(figure, (*METHODS, 'tracks'), papers)
    return figure
