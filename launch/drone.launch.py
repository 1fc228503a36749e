# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor that looks up, and the node that warns when the drone's marker is overdue."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

_SHARE = FindPackageShare('retrolidar_ros')


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        'params_file': (
            PathJoinSubstitution([_SHARE, 'config', 'retrolidar.yaml']),
            'Parameters of the nodes.',
        ),
        'marker_file': (
            PathJoinSubstitution([_SHARE, 'config', 'markers.yaml']),
            'YAML file of the known markers.',
        ),
        'serial_port': ('', 'Device of the sensor; empty = as in the parameter file.'),
        'namespace': ('retrolidar', 'Of nodes and topics.'),
        'emulate': ('', 'A scene to emulate instead of a sensor, such as drone.'),
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=default, description=description)
            for name, (default, description) in arguments.items()
        ]
        + [
            IncludeLaunchDescription(
                PathJoinSubstitution([_SHARE, 'launch', 'retrolidar.launch.py']),
                launch_arguments=[(name, LaunchConfiguration(name)) for name in arguments],
            ),
            Node(
                package='retrolidar_ros',
                executable='heartbeat',
                namespace=LaunchConfiguration('namespace'),
                parameters=[LaunchConfiguration('params_file')],
                output='screen',
            ),
        ]
    )
