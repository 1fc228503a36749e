# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole chain on one machine: emulated sensor, driver and detector, against the truth."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from retrolidar_ros.cli.arguments import output_path
from retrolidar_ros.cli.plot import plot_readings
from retrolidar_ros.cli.processes import ProcessError, ProcessGroup
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import find_scene, load_scene
from retrolidar_ros.scene.truth import judge, table
from retrolidar_ros.settings.files import shared_file

if TYPE_CHECKING:
    from retrolidar_ros.nodes.listener import Listener

HELP = 'run emulated sensor, driver and detector, and compare with the truth'
NAMESPACE = '/retrolidar'
COMMON = (
    *('--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))),
    *('-r', f'__ns:={NAMESPACE}'),
)
"""Arguments of each node."""
READINGS = 3  # how often each marker must be read before the demo ends
_PATIENCE_S = 60.0
_TAKEN = (
    f'another driver publishes {NAMESPACE}/frames; end it, or set ROS_DOMAIN_ID to a free number'
)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    command.add_argument(
        'scene', nargs='?', default='coffee', help='name or file of a scene (default: coffee)'
    )
    command.add_argument(
        '-o', '--output', type=output_path, help='picture to write (default: demo_SCENE.png)'
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the demo of a scene; return 0 if all its markers were read well, else 1."""
    file = find_scene(arguments.scene)
    scene = load_scene(arguments.scene)
    if not scene.markers:
        raise ValueError(f'{arguments.scene} has no markers; there is nothing to read')
    try:
        from retrolidar_ros.cli.demo_arm import run_arm
        from retrolidar_ros.nodes.listener import Listener
    except ImportError as error:
        raise ValueError(f'the demo needs ROS 2 and this package built for it: {error}') from error
    picture = arguments.output or Path(f'demo_{file.stem}.png')
    run_scene = run_arm if len(scene.sensor.path) > 1 else run_still
    listener = Listener(NAMESPACE)
    try:
        return run_scene(scene, file, picture, listener)
    except ProcessError as error:
        print(f'retrolidar: {error}', file=sys.stderr)
        return 1
    finally:
        listener.close()


def executable(node: str) -> str:
    """Return the installed executable of a node, which `ros2 run` would start."""
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix('retrolidar_ros')) / 'lib' / 'retrolidar_ros' / node)


@contextmanager
def running_nodes(
    listener: Listener, landmarks: Sequence[str] = ()
) -> Iterator[tuple[ProcessGroup, Path]]:
    """Yield the running nodes, `landmarks` if it has options, and the port where they wait."""
    with (
        TemporaryDirectory(prefix='retrolidar_') as directory,
        ProcessGroup(Path(directory)) as processes,
    ):
        if listener.spin_until(lambda: listener.node.count_publishers('frames') > 0, 1.0):
            raise ProcessError(_TAKEN)
        port = Path(directory) / 'port'
        processes.start('driver', [executable('driver'), *COMMON, '-p', f'serial_port:={port}'])
        processes.start('detector', [executable('detector'), *COMMON])
        if landmarks:
            processes.start('landmarks', [executable('landmarks'), *COMMON, *landmarks])

        def are_ready() -> bool:
            processes.check()
            placing = listener.node.count_publishers('landmarks/marker_array') > 0
            return listener.is_connected() and (placing or not landmarks)

        if not listener.spin_until(are_ready, _PATIENCE_S):
            raise ProcessError(f'no nodes within {_PATIENCE_S:g} s')
        yield processes, port


def start_emulator(processes: ProcessGroup, scene: str, port: Path, *options: str) -> None:
    """Start the emulator of a scene."""
    emulate = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate']
    processes.start('emulator', [*emulate, scene, '--port-link', str(port), *options])


def _listen(scene: Scene, listener: Listener, processes: ProcessGroup) -> None:
    names = {marker.id: marker.name for marker in scene.markers}
    shown: set[int] = set()

    def done() -> bool:
        processes.check()
        readings = [message.id for message, _ in listener.markers]
        for identity in names.keys() & set(readings) - shown:
            shown.add(identity)
            print(f'  {names[identity]} was read', flush=True)
        enough = all(readings.count(identity) >= READINGS for identity in names)
        return enough and not listener.untransformed()

    listener.spin_until(done, _PATIENCE_S)


def run_still(scene: Scene, file: Path, picture: Path, listener: Listener) -> int:
    """Compare what is read of a scene with the truth; return 0 if all is read well, else 1."""
    print(f'{scene.description}\nDriver and detector are starting ...', flush=True)
    with running_nodes(listener) as (processes, port):
        print('  driver and detector wait for the sensor', flush=True)
        start_emulator(processes, str(file), port)
        _listen(scene, listener, processes)
    recording, readings = listener.recording(), listener.readings()
    if recording is None:
        raise ProcessError(f'no frame came within {_PATIENCE_S:g} s')
    outcomes = judge(scene, recording, readings, listener.untransformed())
    print(f'\n{table(outcomes)}\n')
    plot_readings(recording, readings, picture, title=scene.description, markers=scene.markers)
    print(f'picture: {picture}')
    good = [outcome for outcome in outcomes if outcome.good]
    said = f'{len(good)} of {len(scene.markers)} markers read'
    print(f'{said}, the position within its 99.9 % ellipsoid')
    return 0 if len(good) == len(scene.markers) else 1
