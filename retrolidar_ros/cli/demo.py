# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole chain on one machine: emulated sensor, driver and detector, against the truth."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from retrolidar_ros.cli.arguments import Subparsers, seconds
from retrolidar_ros.cli.picture import Reading, plot_readings
from retrolidar_ros.cli.processes import ProcessError, ProcessGroup
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.files import find_scene, load_scene
from retrolidar_ros.scene.truth import MAX_RANGE_ERROR_M, judge, table
from retrolidar_ros.settings.resources import shared_file

if TYPE_CHECKING:
    from retrolidar_ros.nodes.listener import Listener

NAMESPACE = '/retrolidar'
READINGS = 3
"""How often each marker must be read before the demo ends."""
_TAKEN = (
    f'another driver publishes {NAMESPACE}/frames; end it, or set ROS_DOMAIN_ID to a free number'
)


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar demo`."""
    command = subparsers.add_parser(
        'demo', help='run emulated sensor, driver and detector, and compare with the truth'
    )
    command.add_argument(
        'scene', nargs='?', default='coffee', help='name or file (default: coffee)'
    )
    command.add_argument('-o', '--output', type=Path, help='picture (default: demo_SCENE.png)')
    command.add_argument('--timeout', type=seconds, default=60.0, help='give up after [s]')
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run a scene, and compare what was read with the truth."""
    return run_demo(arguments.scene, arguments.output, arguments.timeout)


def executable(node: str) -> str:
    """Return the installed executable of a node, which `ros2 run` would start."""
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix('retrolidar_ros')) / 'lib' / 'retrolidar_ros' / node)


def check_alone(listener: Listener) -> None:
    """Raise ProcessError if another driver uses the demo's namespace."""
    if listener.spin_until(lambda: listener.node.count_publishers('frames') > 0, 1.0):
        raise ProcessError(_TAKEN)


def start_nodes(processes: ProcessGroup, port: Path) -> None:
    """Start driver and detector with the shipped parameter file."""
    common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
    common += ['-r', f'__ns:={NAMESPACE}']
    processes.start('driver', [executable('driver'), *common, '-p', f'serial_port:={port}'])
    processes.start('detector', [executable('detector'), *common])


def start_emulator(processes: ProcessGroup, scene: str, port: Path, *options: str) -> None:
    """Start the emulator of a scene."""
    emulate = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate']
    processes.start('emulator', [*emulate, scene, '--port-link', str(port), *options])


def _listen(scene: Scene, listener: Listener, processes: ProcessGroup, timeout_s: float) -> None:
    """Process messages until every marker was read often enough, and print progress."""
    names = {marker.id: marker.name for marker in scene.markers}
    shown: set[int] = set()

    def done() -> bool:
        processes.check()
        readings = [message.id for message, _ in listener.markers]
        for identity in names.keys() & set(readings) - shown:
            shown.add(identity)
            print(f'  {names[identity]} was read', flush=True)
        enough = all(readings.count(identity) >= READINGS for identity in names)
        return enough and all(heard.has_transform for heard in listener.heard())

    listener.spin_until(done, timeout_s)


def _is_ready(listener: Listener, processes: ProcessGroup) -> bool:
    """Return whether driver, detector and listener are connected."""
    processes.check()
    return listener.is_connected()


def run_demo(scene_name: str, picture: Path | None, timeout_s: float) -> int:
    """Run the demo of a scene; return 0 if all its markers were read well, else 1."""
    scene = load_scene(scene_name)
    if not scene.markers:
        raise ValueError(f'{scene_name} has no markers; there is nothing to read')
    try:
        from retrolidar_ros.nodes.listener import Listener
    except ImportError as error:
        raise ValueError(f'the demo needs ROS 2 and this package built for it: {error}') from error
    picture = picture or Path(f'demo_{find_scene(scene_name).stem}.png')
    if len(scene.sensor.path) > 1:
        from retrolidar_ros.cli.demo_arm import run_arm

        return run_arm(scene, find_scene(scene_name), picture, timeout_s)
    print(f'{scene.description}\nDriver and detector are starting ...', flush=True)
    with TemporaryDirectory(prefix='retrolidar_') as directory:
        listener = Listener(NAMESPACE)
        try:
            with ProcessGroup(Path(directory)) as processes:
                port = Path(directory) / 'port'
                check_alone(listener)
                start_nodes(processes, port)
                if not listener.spin_until(lambda: _is_ready(listener, processes), timeout_s):
                    print(f'retrolidar: no nodes within {timeout_s:g} s', file=sys.stderr)
                    return 1
                print('  driver and detector wait for the sensor', flush=True)
                start_emulator(processes, str(find_scene(scene_name)), port)
                _listen(scene, listener, processes, timeout_s)
        except ProcessError as error:
            print(f'retrolidar: {error}', file=sys.stderr)
            return 1
        finally:
            listener.close()
    recording, heard = listener.recording(), listener.heard()
    if recording is None:
        print(f'retrolidar: no frame came within {timeout_s:g} s', file=sys.stderr)
        return 1
    outcomes = judge(scene, recording, heard)
    print(f'\n{table(outcomes)}\n')
    names = {marker.id: marker.name for marker in scene.markers}
    origin_ns = int(recording.stamp_ns[0])
    plot_readings(
        recording,
        [
            Reading(
                id=one.id,
                name=names.get(one.id, 'ghost'),
                start_s=(one.start_ns - origin_ns) * 1e-9,
                stamp_s=(one.stamp_ns - origin_ns) * 1e-9,
                range_m=one.range_m,
                position_m=one.position_m,
                zone=one.zone,
            )
            for one in heard
        ],
        picture,
        origin_ns=origin_ns,
        title=scene.description,
        truth_m={marker.name: marker.position_m for marker in scene.markers},
    )
    print(f'picture: {picture}')
    good = [outcome for outcome in outcomes if outcome.good]
    print(
        f'{len(good)} of {len(scene.markers)} markers read with a range error below '
        f'{MAX_RANGE_ERROR_M * 1e3:.0f} mm'
    )
    return 0 if len(good) == len(scene.markers) else 1
