# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of bearing and position, and whether the covariance is right."""

from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.places import ELLIPSOID, held, place_error, rms
from evaluation.report.chart_style import OTHERS, label, legend_below, line, new_chart
from evaluation.report.claims import Claims, Table, as_text, model, percent
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import MARKER_SIZE_M, Marker, Surface
from retrolidar_ros.scene.optics import zone_shares
from retrolidar_ros.scene.reference import RESPONSE, SENSOR

TITLE = 'Bearing, and how honest the covariance is'
DURATION_S = 2.9  # a marker that repeats is read once
_FAIR_SHARE = 0.05
_BLURS = (0.05, 0.25)
_RANGES_M = (0.4, 2.6)
_QUICK_MARKERS = 60
# From a wall that a marker merges with to one that the sensor separates.
_BEHIND_M = (0.005, 1.5)
_WALL_SIGNALS = (1.0, 40.0)  # [kcps/SPAD]
_LARGE_M = 0.1
_NAMES = {'alone': 'alone in a zone', 'between': 'between zones'}


def random_scene(blur: float, rng: np.random.Generator, size_m: float = MARKER_SIZE_M) -> Scene:
    """Return one marker anywhere in the field of view, before a wall of any distance."""
    half = SENSOR.grid.view / 2
    ray = np.append(rng.uniform(-half, half, 2), 1.0)
    x, y, z = (rng.uniform(*_RANGES_M) * ray / np.linalg.norm(ray)).tolist()
    id_, start_s = int(rng.choice(USABLE_IDS)), float(-rng.uniform(0, 1.3))
    marker = Marker(id_, (x, y, z), size_m=size_m, start_s=start_s, response=RESPONSE)
    wall = Surface(z + float(rng.uniform(*_BEHIND_M)), float(rng.uniform(*_WALL_SIGNALS)))
    return Scene(sensor=replace(SENSOR, blur=blur), markers=(marker,), surfaces=(wall,))


def seen_by_two(detection: Detection, scene: Scene) -> tuple[bool, bool]:
    """Return whether zones of two columns, and of two rows, have seen the marker of a scene.

    They must have read it, and the second must get a fair share of the light.
    """
    (marker,) = scene.markers
    sensor, grid = scene.sensor, scene.sensor.grid
    places = np.array([marker.position_m])
    light = zone_shares(places, marker.size_m, grid, sensor.blur).reshape(grid.rows, grid.columns)
    rows, columns = np.divmod(np.array(detection.zones), grid.columns)
    across = np.ptp(columns) > 0 and np.sort(light.sum(axis=0))[-2] > _FAIR_SHARE
    down = np.ptp(rows) > 0 and np.sort(light.sum(axis=1))[-2] > _FAIR_SHARE
    return bool(across), bool(down)


def _error(scene: Scene, rng: np.random.Generator) -> tuple[Any, ...] | None:
    """Return the errors of the first reading of the only marker; None if it is not read.

    These are the squared distance in standard deviations, the range [m], and, across and down,
    the bearing [°], that of the centre of the strongest zone [°], and whether two saw the marker.
    """
    (marker,) = scene.markers
    grid = scene.sensor.grid
    recording = Simulation(scene, rng).run(DURATION_S)
    for one in create_detector('joint', grid).update_all(recording):
        if one.id == marker.id:
            truth_m = np.array(marker.position_m)
            wrong = place_error(one.place, truth_m)
            measured = one.place.position_m[:2] / one.place.position_m[2]
            tangents = np.array([measured, grid.tangents[one.zones[0]], truth_m[:2] / truth_m[2]])
            angles = np.degrees(np.arctan(tangents))
            off, centre = angles[:2] - angles[2]
            return wrong.squared_distance, wrong.range_m, off, centre, seen_by_two(one, scene)
    return None


def _figures(blur: float, rows: list[tuple[Any, ...] | None]) -> dict[str, Any]:
    read = [row for row in rows if row is not None]
    distance, range_m, bearing, centre, axes = map(np.array, zip(*read, strict=True))
    bearing, centre = np.abs(bearing), np.abs(centre)
    along = {'alone': ~axes, 'between': axes}
    whole = {'alone': ~axes.any(axis=1), 'between': axes.any(axis=1)}
    return {
        'blur': blur,
        'ellipsoid_holds': {name: held(distance[group]) for name, group in whole.items()},
        'bearing_rms_deg': {name: rms(bearing[group]) for name, group in along.items()},
        'centre_rms_deg': {name: rms(centre[group]) for name, group in along.items()},
        'bearing_deg': {name: bearing[group].round(4).tolist() for name, group in along.items()},
        'distance': {
            name: np.sqrt(distance[group]).round(4).tolist() for name, group in whole.items()
        },
        'range_median_m': float(np.median(np.abs(range_m))),
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return errors and coverage of markers alone in a zone and between zones, by blur."""
    markers = _QUICK_MARKERS if quick else 600

    def of(blur: float, size_m: float = MARKER_SIZE_M) -> dict[str, Any]:
        return _figures(
            blur, [_error(random_scene(blur, rng, size_m), rng) for _ in range(markers)]
        )

    return {'blurs': [of(blur) for blur in _BLURS], 'large': of(_BLURS[0], _LARGE_M)}


def table(figures: dict[str, Any]) -> Table:
    """Return errors and coverage, by blur and by how many zones see the marker."""
    head = 'bearing: rms error/that of zone centres/in the 95 % ellipsoid'
    rows = [[head, *_NAMES.values(), 'median range error [mm]']]
    for row in [*figures['blurs'], figures['large']]:
        size = '' if row is not figures['large'] else f'{100 * _LARGE_M:g} cm, '
        cells = []
        for name in _NAMES:
            errors = (as_text(row[key][name], '°') for key in ('bearing_rms_deg', 'centre_rms_deg'))
            cells.append('/'.join((*errors, percent(row['ellipsoid_holds'][name]))))
        median = as_text(1e3 * row['range_median_m'], '', 1)
        rows.append([f'{size}blur {row["blur"]:.0%} of a zone', *cells, median])
    return rows


def claims(figures: dict[str, Any]) -> Claims:
    """Return the error of the range."""
    median_mm = 1e3 * figures['blurs'][0]['range_median_m']
    return {'range': model(f'{median_mm:.1f} mm of range')}


def draw(figures: dict[str, Any]) -> Any:
    """Draw the distribution of bearing errors, and of distances in standard deviations."""
    blurs = figures['blurs']
    off = {name: as_text(one, '°', 1) for name, one in blurs[0]['bearing_rms_deg'].items()}
    holds = [one['rate'] for row in blurs for one in row['ellipsoid_holds'].values() if one]
    words = f'Bearings are {off["between"]} off between zones (rms), {off["alone"]} in one zone'
    title = f'{words}; {min(holds):.0%} to {max(holds):.0%} of markers are in their 95 % ellipsoid'
    figure, panels = new_chart(2, 2, 4.6, title)
    axes = (
        ('bearing_deg', 'error of the bearing [°]', 8),
        ('distance', 'distance from the truth [deviations]', 5),
    )
    looks = {
        f'{words}, blur {row["blur"]:.0%}': (row, name, line(style, colour))
        for row, colour in zip(figures['blurs'], OTHERS, strict=False)
        for (name, words), style in zip(_NAMES.items(), (':', '-'), strict=True)
    }
    for axis, (key, x, most) in zip(panels, axes, strict=True):
        for row, name, how in looks.values():
            values = np.sort(row[key][name])
            axis.plot(values, 100 * (np.arange(len(values)) + 0.5) / max(len(values), 1), **how)
        label(axis, x, 'markers [%]', percent=True, xlim=(0, most))
    dashed = line('--', '0.4')
    panels[1].axvline(np.sqrt(ELLIPSOID), **dashed, linewidth=1)
    panels[1].axhline(95, **dashed, linewidth=1)
    others = {words: how for words, (_, _, how) in looks.items()}
    legend_below(figure, (), others | {'95 % ellipsoid': dashed})
    return figure
