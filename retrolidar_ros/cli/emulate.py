# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Emulate a sensor that sees a scene."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from retrolidar_ros.bag import STORAGES
from retrolidar_ros.cli.arguments import Subparsers, number_of_seconds, seconds
from retrolidar_ros.scene.description import Waypoint
from retrolidar_ros.scene.emulator import emulate, record
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.interrupts import interrupted_once


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar emulate`."""
    command = subparsers.add_parser('emulate', help='emulate a sensor that sees a scene')
    command.add_argument('scene', help='name or file')
    where = command.add_mutually_exclusive_group(required=True)
    where.add_argument('--port-link', type=Path, help='in real time, at a serial port linked here')
    where.add_argument('--bag', type=Path, help='at once, into a new rosbag2 directory')
    command.add_argument(
        '--storage', choices=STORAGES, default=STORAGES[0], help='of the bag (default: %(default)s)'
    )
    command.add_argument('--duration', type=seconds, help='stop after [s]')
    command.add_argument(
        '--at',
        type=float,
        nargs=3,
        metavar=('X', 'Y', 'Z'),
        help='position of the sensor in the scene [m]',
    )
    command.add_argument('--seed', type=int, help="of the noise (default: the scene's)")
    command.add_argument(
        '--start',
        type=number_of_seconds,
        help="the scene's time zero, by this machine's monotonic clock (default: now) [s]",
    )
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Emulate a sensor at a serial port, or write a bag."""
    scene = load_scene(arguments.scene)
    if arguments.at is not None:
        path = (Waypoint(0.0, tuple(arguments.at)),)
        scene = replace(scene, sensor=replace(scene.sensor, path=path))
    if arguments.seed is not None:
        scene = replace(scene, seed=arguments.seed)
    if arguments.bag is not None:
        duration_s = scene.duration_s if arguments.duration is None else arguments.duration
        frames = record(scene, arguments.bag, arguments.storage, duration_s)
        print(f'{frames} frames of {duration_s:g} s in {arguments.bag}')
        return 0

    def say_ready() -> None:
        print(f'a sensor is at {arguments.port_link}; Ctrl-C unplugs it', flush=True)

    start_ns = None if arguments.start is None else round(arguments.start * 1e9)
    with interrupted_once():
        sent, lost = emulate(scene, arguments.port_link, arguments.duration, say_ready, start_ns)
    print(f'{sent} frames sent, {lost} found no listener')
    return 0
