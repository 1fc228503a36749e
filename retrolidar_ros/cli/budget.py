# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Link, wake-up and battery life to expect of a marker."""

import argparse
import json
import math
from typing import Any

from retrolidar_ros.marker.power import CELL_MAH
from retrolidar_ros.scene.marker_budget import SENSOR_REACH_M, SNR, budget
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.settings.section import quantity

HELP = 'expected link, wake-up and battery life of a marker'
DESCRIPTION = 'Quantities carry their units, as in scene files; bare lengths are in metres.'


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    for name, default, what in (
        ('size', '3 cm', 'edge of the retroreflector'),
        ('yaw', '0 deg', "angle between the marker's normal and the line of sight"),
        ('distance', '2 m', 'from the sensor'),
        ('cell', f'{CELL_MAH:g} mAh', 'capacity of the battery'),
    ):
        command.add_argument(f'--{name}', default=default, help=f'{what} (default: %(default)s)')
    command.add_argument(
        '--queries', type=float, default=1.0, help='packets per hour (default: %(default)g)'
    )
    command.add_argument('--json', action='store_true', help='print one JSON object')


def run(arguments: argparse.Namespace) -> int:
    """Print the budget of a marker; it may be as large as a zone at its distance."""
    distance_m = quantity('length', 0.1, SENSOR_REACH_M, bare=True)(
        arguments.distance, '--distance'
    )
    zone_m = distance_m * float((SENSOR.grid.pitch * SENSOR.grid.z_per_range).min())
    given = {
        'size_m': quantity('length', 1e-3, zone_m, bare=True)(arguments.size, '--size'),
        'yaw_rad': quantity('angle', -math.pi / 2, math.pi / 2)(arguments.yaw, '--yaw'),
        'distance_m': distance_m,
        'cell_mah': quantity('charge', 1.0)(arguments.cell, '--cell'),
        'queries_per_hour': arguments.queries,
    }
    found = given | budget(**given)
    print(json.dumps(found) if arguments.json else _text(found))
    return 0


def _text(found: dict[str, Any]) -> str:
    link, wake_up, battery = found['link'], found['wake_up'], found['battery']
    ratio = 'nothing comes back' if link['snr_db'] is None else f'{link["snr_db"]:.1f} dB'
    reach = f'up to {wake_up["range_m"]:.2f} m' if wake_up['range_m'] else 'at no distance'
    drawn_ua = ', '.join(f'{name} {1e3 * part:.1f}' for name, part in battery['drawn_ma'].items())
    awake = 'wakes' if wake_up['woken'] else 'stays asleep'
    life_h = battery['life_h']
    rows = (
        ('marker', f'{100 * found["size_m"]:g} cm at {found["distance_m"]:g} m'),
        ('', f'yaw {math.degrees(found["yaw_rad"]):g}°'),
        ('link', f'bright {link["bright"]:.1f}, dark {link["dark"]:.1f} kcps/SPAD'),
        ('', f'noise {link["noise"]:.1f} kcps/SPAD, {SNR} {ratio}'),
        ('', f'80 % of lone packets are read to {link["reach_m"]:.2f} m'),
        ('wake-up', f'{1e3 * wake_up["voltage_v"]:.1f} mV indoors'),
        ('', f'threshold {1e3 * wake_up["threshold_v"]:.1f} mV: it {awake}'),
        ('', f'at this yaw it wakes {reach}'),
        ('battery', f'{drawn_ua}, together {1e3 * battery["total_ma"]:.1f} µA'),
        ('', f'queries an hour: {found["queries_per_hour"]:g}, a packet each'),
        ('', f'{found["cell_mah"]:g} mAh last {life_h:.0f} h, {life_h / 24:.1f} days'),
    )
    return '\n'.join(f'{subject:8}{value}' for subject, value in rows)
