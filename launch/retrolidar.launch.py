# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Driver and detector of one sensor, or of an emulated one with `emulate:=SCENE`."""

import os
import sys
import tempfile

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from retrolidar_ros.scene.files import load_scene

# Launch arguments that go before what the parameter file says, if they are given.
_OVERRIDES = {
    'driver': ('serial_port', 'protocol', 'frame_id'),
    'detector': ('marker_file', 'child_frame'),
}


def _end(context):
    """Return the end of the launch, unless it is ending; a second request can hang it."""
    return [] if context.is_shutdown else [Shutdown(reason='the emulated sensor has ended')]


def _nodes(context):
    """Return the processes to start, now that the arguments have values."""

    def value(name):
        return LaunchConfiguration(name).perform(context)

    if not os.path.isfile(value('params_file')):
        raise RuntimeError(f'params_file {value("params_file")} does not exist')
    overrides = {name: value(name) for names in _OVERRIDES.values() for name in names}
    actions = []
    if value('emulate'):
        load_scene(value('emulate'))  # says what is wrong with it before anything is started
        # The driver opens the emulator's port as it would open that of a sensor with our protocol.
        name = f'retrolidar_{os.getpid()}_{value("namespace").strip("/").replace("/", "_")}'
        overrides['serial_port'] = overrides['serial_port'] or os.path.join(
            tempfile.gettempdir(), name
        )
        overrides['protocol'] = 'retrolidar'
        emulator = [sys.executable, '-m', 'retrolidar_ros.cli.main', 'emulate', value('emulate')]
        actions.append(
            ExecuteProcess(
                cmd=[*emulator, '--port-link', overrides['serial_port']],
                name='emulator',
                output='screen',
                on_exit=OpaqueFunction(function=_end),
            )
        )
    for name, names in _OVERRIDES.items():
        given = {key: overrides[key] for key in names if overrides[key]}
        actions.append(
            Node(
                package='retrolidar_ros',
                executable=name,
                namespace=value('namespace'),
                parameters=[value('params_file')] + ([given] if given else []),
                remappings=[('markers', value('markers'))] if name == 'detector' else [],
                output='screen',
            )
        )
    return actions


def generate_launch_description():
    """Return the launch arguments and what they start."""
    params_file = PathJoinSubstitution(
        [FindPackageShare('retrolidar_ros'), 'config', 'retrolidar.yaml']
    )
    arguments = {
        'params_file': (params_file, 'Parameters of the nodes.'),
        'serial_port': ('', 'Device of the sensor; empty = as in the parameter file.'),
        'protocol': ('', 'What the sensor speaks; empty = as in the parameter file.'),
        'frame_id': ('', 'TF frame of the sensor; empty = as in the parameter file.'),
        'marker_file': ('', 'YAML file of the known markers; empty = as in the parameter file.'),
        'child_frame': ('', 'TF frame of a marker; empty = as in the parameter file.'),
        'namespace': ('retrolidar', 'Of nodes and topics.'),
        'markers': ('markers', 'Topic of the detections.'),
        'emulate': ('', 'A scene to emulate instead of a sensor: a file, or the name of one.'),
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=default, description=description)
            for name, (default, description) in arguments.items()
        ]
        + [OpaqueFunction(function=_nodes)]
    )
