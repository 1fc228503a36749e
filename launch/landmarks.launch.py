# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor, and the node that places markers in a fixed frame, or a robot among them."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

_SHARE = FindPackageShare('retrolidar_ros')
# Launch arguments that go before what the parameter file says, if they are given.
_OVERRIDES = ('fixed_frame', 'marker_file', 'load_file', 'save_file', 'base_frame')


def _landmarks(context):
    """Return the node, now that the arguments have values."""

    def value(name):
        return LaunchConfiguration(name).perform(context)

    given = {name: value(name) for name in _OVERRIDES if value(name)}
    given['localize'] = value('localize') == 'true'
    return [
        Node(
            package='retrolidar_ros',
            executable='landmarks',
            namespace=value('namespace'),
            parameters=[value('params_file'), given],
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
        'fixed_frame': ('', 'Frame of the landmarks; empty = as in the parameter file.'),
        'load_file': ('', 'Landmarks of a former survey; empty = as in the parameter file.'),
        'save_file': ('', 'Where ~/save writes; empty = as in the parameter file.'),
        'localize': ('false', 'Tell where base_frame is among the landmarks of load_file.'),
        'base_frame': ('', 'Frame of the robot; empty = as in the parameter file.'),
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
            OpaqueFunction(function=_landmarks),
        ]
    )
