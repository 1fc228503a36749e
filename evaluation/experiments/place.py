# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where markers are said to be, against where they are, and whether the covariance is honest."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from tqdm import tqdm

from evaluation.bench.live import ELLIPSOID, held, place_error
from evaluation.report.charts import new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.marker.code import IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Sensor, Surface
from retrolidar_ros.scene.optics import zone_shares
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Bearing, and how honest the covariance is'
SOURCE = ''

DURATION_S = 2.9  # a marker that repeats is read once
_FAIR_SHARE = 0.05
_BLURS = (0.05, 0.25)
_RANGES_M = (0.4, 2.6)
_MARKERS, _QUICK_MARKERS = 600, 60
# From a wall that a marker merges with to one that the sensor tells apart.
_BEHIND_M = (0.005, 1.5)
_WALL_SIGNALS = (1.0, 40.0)  # [kcps/SPAD]
_NAMES = {'alone': 'alone in a zone', 'between': 'between zones'}


def random_scene(blur: float, rng: np.random.Generator) -> Scene:
    """Return one marker anywhere in the field of view, before a wall of any distance."""
    grid = SENSOR.grid
    half = grid.pitch * grid.columns / 2
    tangent = rng.uniform(-half, half, 2)
    range_m = rng.uniform(*_RANGES_M)
    ray = np.append(tangent, 1.0)
    x, y, z = (range_m * ray / np.linalg.norm(ray)).tolist()
    marker = Marker(
        id=int(1 + rng.integers(IDS - 2)),
        position_m=(x, y, z),
        name='marker',
        start_s=float(-rng.uniform(0, 1.3)),
        response=RESPONSE,
    )
    wall = Surface(z + float(rng.uniform(*_BEHIND_M)), float(rng.uniform(*_WALL_SIGNALS)))
    sensor = Sensor(grid=grid, noise=NOISE, ranging=SENSOR.ranging, blur=blur)
    return Scene(sensor=sensor, markers=(marker,), surfaces=(wall,))


def seen_by_two(detection: Detection, scene: Scene) -> tuple[bool, bool]:
    """Tell whether zones of two columns, and of two rows, have seen the marker of a scene.

    They have if they have read it, and the second got a fair share of the light: traces of light
    beside a bright marker tell nothing.
    """
    (marker,) = scene.markers
    sensor, grid = scene.sensor, scene.sensor.grid
    places = np.array([marker.position_m])
    light = zone_shares(places, marker.size_m, grid, sensor.blur).reshape(grid.rows, grid.columns)
    rows, columns = np.divmod(np.array(detection.zones), grid.columns)
    across = np.ptp(columns) > 0 and np.sort(light.sum(axis=0))[-2] > _FAIR_SHARE
    down = np.ptp(rows) > 0 and np.sort(light.sum(axis=1))[-2] > _FAIR_SHARE
    return bool(across), bool(down)


def first_reading(scene: Scene, rng: np.random.Generator) -> Detection | None:
    """Return how the only marker of a scene is read first; None if it is not."""
    (marker,) = scene.markers
    recording = Simulation(scene, rng).run(DURATION_S)
    detections = create_detector('joint', recording.grid).update_all(recording)
    return next((one for one in detections if one.id == marker.id), None)


class Error(NamedTuple):
    """By how much a marker's place was wrong."""

    squared_distance: float
    """In standard deviations of the covariance."""
    range_m: float
    range_score: float
    """In its own standard deviations."""
    bearing_deg: tuple[float, float]
    """Across and down."""
    centre_deg: tuple[float, float]
    """The same of the centre of the strongest zone."""
    between: tuple[bool, bool]
    """Whether two columns and two rows saw the marker."""


def error_of(detection: Detection, scene: Scene) -> Error:
    """Return by how much the place of the only marker of a scene is wrong."""
    place, grid = detection.place, scene.sensor.grid
    truth_m = np.array(scene.markers[0].position_m)
    wrong = place_error(place, truth_m)
    angles = np.degrees(np.arctan(truth_m[:2] / truth_m[2]))

    def wrong_by(tangents: Floats) -> tuple[float, float]:
        across, down = (np.degrees(np.arctan(tangents)) - angles).tolist()
        return across, down

    return Error(
        squared_distance=wrong.squared_distance,
        range_m=wrong.range_m,
        range_score=wrong.range_m / place.range_stddev_m,
        bearing_deg=wrong_by(place.position_m[:2] / place.position_m[2]),
        centre_deg=wrong_by(grid.tangents[detection.zones[0]]),
        between=seen_by_two(detection, scene),
    )


def _rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _figures(blur: float, rows: list[Error]) -> dict[str, Any]:
    """Sum up the errors of markers that a sensor of some blur has seen."""
    axes = np.array([row.between for row in rows])
    bearing = np.abs([row.bearing_deg for row in rows])
    centre = np.abs([row.centre_deg for row in rows])
    distance = np.array([row.squared_distance for row in rows])
    between = axes.any(axis=1)
    along = {'alone': ~axes, 'between': axes}
    return {
        'blur': blur,
        'ellipsoid_holds': {
            name: held(distance[group])
            for name, group in (('alone', ~between), ('between', between))
        },
        'bearing_rms_deg': {name: _rms(bearing[group]) for name, group in along.items()},
        'centre_rms_deg': {name: _rms(centre[group]) for name, group in along.items()},
        'bearing_deg': {
            name: np.sort(np.round(bearing[group], 3)).tolist() for name, group in along.items()
        },
        'squared_distance': {
            'alone': np.sort(np.round(distance[~between], 3)).tolist(),
            'between': np.sort(np.round(distance[between], 3)).tolist(),
        },
        'range_rms_m': _rms([row.range_m for row in rows]),
        'range_median_m': float(np.median(np.abs([row.range_m for row in rows]))),
        'range_score_rms': _rms([row.range_score for row in rows]),
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return errors and coverage of markers alone in a zone and between zones, by blur."""
    markers = _QUICK_MARKERS if quick else _MARKERS
    blurs = []
    with tqdm(total=len(_BLURS) * markers, desc='place', leave=False) as progress:
        for blur in _BLURS:
            rows = []
            for _ in range(markers):
                scene = random_scene(blur, rng)
                detection = first_reading(scene, rng)
                if detection is not None:
                    rows.append(error_of(detection, scene))
                progress.update()
            blurs.append(_figures(blur, rows))
    return {'markers': markers, 'ranges_m': list(_RANGES_M), 'blurs': blurs}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = []
    for row in figures['blurs']:
        lines.append(
            f'blur of {row["blur"]:.0%} of a zone: range error {row["range_rms_m"] * 1e3:.1f} mm '
            f'rms, {row["range_median_m"] * 1e3:.1f} mm median, {row["range_score_rms"]:.2f} '
            f'standard deviations'
        )
        for name in _NAMES:
            holds = row['ellipsoid_holds'][name]
            lines.append(
                f'  {_NAMES[name]:16} {holds["hits"]}/{holds["trials"]} = {holds["rate"]:.1%} '
                f'within the 95 % ellipsoid, bearing error {row["bearing_rms_deg"][name]:.2f}° '
                f'rms ({row["centre_rms_deg"][name]:.2f}° by zone centres)'
            )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set errors and coverage of both blurs side by side."""
    claims = []
    for row in figures['blurs']:
        blur = f'blur of {row["blur"]:.0%} of a zone'
        holds = row['ellipsoid_holds']
        claims += [
            Claim(
                f'median range error, {blur}',
                default=f'{1e3 * row["range_median_m"]:.1f} mm',
            ),
            Claim(
                f'bearing error, {blur}: alone in a zone, between zones',
                default=' and '.join(f'{row["bearing_rms_deg"][name]:.2f}°' for name in _NAMES)
                + ' rms',
            ),
            Claim(
                f'truth within the 95 % ellipsoid, {blur}: alone, between',
                default=' and '.join(
                    '–' if holds[name] is None else f'{holds[name]["rate"]:.1%}' for name in _NAMES
                ),
            ),
        ]
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say what a place is worth."""
    centre = figures['blurs'][0]['centre_rms_deg']['alone']
    return (
        'The paper gives ranges, and no error of the bearing; the millimetre of its Tab. 6 stands '
        'beside full positions of other systems, but is a range. A marker that one zone sees alone '
        f'may be anywhere in it: {centre:.1f}° rms from the middle of the zone, a decimetre at '
        '2 m. Millimetres hold along the line of sight only. Where a wall stands within '
        'centimetres of what the sensor tells apart, the two merge now and then, and range errors '
        'are large.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw the distribution of bearing errors, and of distances in standard deviations."""
    figure, ((bearing, honest),) = new_chart(1, 2, 14, 5.5)
    for row, colour in zip(figures['blurs'], ('#0072b2', '#d55e00'), strict=True):
        for name, style in zip(_NAMES, (':', '-'), strict=True):
            label = f'{_NAMES[name]}, blur {row["blur"]:.0%}'
            look = {'color': colour, 'linestyle': style, 'label': label}
            errors = row['bearing_deg'][name]
            bearing.plot(errors, _percent(len(errors)), **look)
            distances = np.sqrt(row['squared_distance'][name])
            honest.plot(distances, _percent(len(distances)), **look)
    bearing.set_xlabel('error of the bearing along one axis [°]')
    bearing.set_xlim(0, 8)
    bearing.set_title('how well the bearing is known')
    honest.axvline(np.sqrt(ELLIPSOID), color='0.4', linestyle='--', linewidth=1)
    honest.text(np.sqrt(ELLIPSOID) + 0.05, 60, '95 % ellipsoid', color='0.3')
    honest.axhline(95, color='0.4', linestyle='--', linewidth=1)
    honest.set_xlabel('distance from the truth, in standard deviations of the covariance')
    honest.set_xlim(0, 5)
    honest.set_title('how honest the covariance is')
    for axis in (bearing, honest):
        axis.set_ylabel('markers [%]')
        axis.set_ylim(0, 101)
        axis.legend(loc='lower right', fontsize=10)
    low, high = figures['ranges_m']
    figure.suptitle(
        f'Markers anywhere in the field of view, {low:g} to {high:g} m, before walls of all kinds'
    )
    figure.savefig(path)


def _percent(count: int) -> Floats:
    return 100 * (np.arange(count) + 0.5) / count
