# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Emulate a sensor that sees a scene."""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path

from retrolidar_ros.cli.arguments import add_storage, measured, output_path, seconds, whole
from retrolidar_ros.scene.description import MAX_SEED, Waypoint, load_scene, scene_names
from retrolidar_ros.scene.emulator import emulate, record
from retrolidar_ros.settings.interrupts import interrupted_once

HELP = 'emulate a sensor that sees a scene'
DESCRIPTION = 'Without a scene, lists those that ship with the package.'


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    command.add_argument('scene', nargs='?', help='name or file of a scene')
    where = command.add_mutually_exclusive_group()
    where.add_argument(
        '--port-link',
        type=Path,
        help='act in real time as a sensor at a serial port with this path',
    )
    where.add_argument(
        '--bag', type=output_path, help='write frames at once into a new rosbag2 directory'
    )
    add_storage(command)
    command.add_argument('--duration', type=seconds, help='end after this time [s]')
    command.add_argument(
        '--at',
        type=measured('length', -1e3, 1e3),
        nargs=3,
        metavar=('X', 'Y', 'Z'),
        help='position of the sensor in the scene [m]',
    )
    command.add_argument(
        '--seed', type=whole(0, MAX_SEED), help="seed of the noise (default: the scene's)"
    )
    command.add_argument(
        '--start',
        type=measured('time', -1e9, 1e9),
        help="when the scene begins, by this machine's monotonic clock (default: now) [s]",
    )


def run(arguments: argparse.Namespace) -> int:
    """Emulate a sensor at a serial port, or write a bag."""
    if arguments.scene is None:
        for name in scene_names():
            print(f'{name:8}{load_scene(name).description}')
        return 0
    scene = load_scene(arguments.scene)
    if arguments.bag is None and arguments.port_link is None:
        raise ValueError(
            'emulate needs --port-link PATH or --bag DIR; see retrolidar emulate --help'
        )
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
    told = f'a sensor is at {arguments.port_link}; Ctrl-C unplugs it'
    ready = partial(print, told, flush=True)
    start_ns = None if arguments.start is None else round(arguments.start * 1e9)
    with interrupted_once():
        sent, lost = emulate(scene, arguments.port_link, arguments.duration, ready, start_ns)
    print(f'{sent} frames sent, {lost} found no listener')
    return 0
