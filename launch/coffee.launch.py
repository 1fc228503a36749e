# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor, and the node that waits until beans, machine and mug are placed."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

_SHARE = FindPackageShare('retrolidar_ros')


def _coffee(context):
    """Return the node, now that the arguments have values."""

    def value(name):
        return LaunchConfiguration(name).perform(context)

    given = {'target_frame': value('target_frame')} if value('target_frame') else {}
    if value('max_stddev'):
        given['max_stddev'] = float(value('max_stddev'))
    return [
        Node(
            package='retrolidar_ros',
            executable='coffee',
            namespace=value('namespace'),
            parameters=[value('params_file')] + ([given] if given else []),
            output='screen',
        )
    ]


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
        'target_frame': ('', 'Frame of the poses; empty = as in the parameter file.'),
        'max_stddev': ('', 'How uncertain places may be [m]; empty = as in the parameter file.'),
        'namespace': ('retrolidar', 'Of nodes and topics.'),
        'emulate': ('', 'A scene to emulate instead of a sensor, such as coffee.'),
    }
    passed_on = ('params_file', 'marker_file', 'serial_port', 'namespace', 'emulate')
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=default, description=description)
            for name, (default, description) in arguments.items()
        ]
        + [
            IncludeLaunchDescription(
                PathJoinSubstitution([_SHARE, 'launch', 'retrolidar.launch.py']),
                launch_arguments=[(name, LaunchConfiguration(name)) for name in passed_on],
            ),
            OpaqueFunction(function=_coffee),
        ]
    )
