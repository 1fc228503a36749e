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

from retrolidar_ros.yaml_files import load_scene


def _nodes(context):
    """Return the processes to start, now that the arguments have values."""
    serial_port = LaunchConfiguration('serial_port').perform(context)
    scene = LaunchConfiguration('emulate').perform(context)
    params_file = LaunchConfiguration('params_file').perform(context)
    if not os.path.isfile(params_file):
        raise RuntimeError(f'params_file {params_file} does not exist')
    namespace = LaunchConfiguration('namespace')
    parameters = [params_file]
    actions = []
    if scene:
        load_scene(scene)  # says what is wrong with it before anything is started
        # The driver opens the emulator's port as it would open a sensor's.
        serial_port = serial_port or os.path.join(
            tempfile.gettempdir(), f'retrolidar_{os.getpid()}'
        )
        emulator = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate', scene]
        actions.append(
            ExecuteProcess(
                cmd=[*emulator, '--port-link', serial_port],
                name='emulator',
                output='screen',
                on_exit=Shutdown(reason='the emulated sensor has ended'),
            )
        )
    driver_parameters = parameters + ([{'serial_port': serial_port}] if serial_port else [])
    for name, node_parameters in (('driver', driver_parameters), ('detector', parameters)):
        actions.append(
            Node(
                package='retrolidar_ros',
                executable=name,
                namespace=namespace,
                parameters=node_parameters,
                output='screen',
            )
        )
    return actions


def generate_launch_description():
    """Return the launch arguments and what they start."""
    params_file = PathJoinSubstitution(
        [FindPackageShare('retrolidar_ros'), 'config', 'retrolidar.yaml']
    )
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file', default_value=params_file, description='Parameters of the nodes.'
            ),
            DeclareLaunchArgument(
                'serial_port',
                default_value='',
                description='Device of the sensor; empty = as in the parameter file.',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='retrolidar', description='Of nodes and topics.'
            ),
            DeclareLaunchArgument(
                'emulate',
                default_value='',
                description='A scene to emulate instead of a sensor: a file, or the name of one.',
            ),
            OpaqueFunction(function=_nodes),
        ]
    )
