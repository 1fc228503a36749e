# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two sensors, left and right, whose detections come on one topic.

Each has its own namespace, port and frame. A marker that both see has a TF frame below each, such
as left_mug and right_mug, for TF allows a frame but one parent.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, GroupAction, IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

_SHARE = FindPackageShare('retrolidar_ros')
_SIDES = ('left', 'right')


def _sensor(side):
    """Return driver and detector of one side."""
    namespace = LaunchConfiguration('namespace')
    arguments = {
        'params_file': LaunchConfiguration('params_file'),
        'marker_file': LaunchConfiguration('marker_file'),
        'serial_port': LaunchConfiguration(f'{side}_port'),
        'frame_id': LaunchConfiguration(f'{side}_frame'),
        'emulate': LaunchConfiguration(f'{side}_emulate'),
        'child_frame': side + '_{name}',
        'namespace': [namespace, '/' + side],
        'markers': ['/', namespace, '/markers'],
    }
    return GroupAction(
        [
            IncludeLaunchDescription(
                PathJoinSubstitution([_SHARE, 'launch', 'retrolidar.launch.py']),
                launch_arguments=arguments.items(),
            )
        ]
    )


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        'params_file': (
            PathJoinSubstitution([_SHARE, 'config', 'retrolidar.yaml']),
            'Parameters of the nodes.',
        ),
        'marker_file': ('', 'YAML file of the known markers; empty = as in the parameter file.'),
        'namespace': ('retrolidar', 'Of both, which add /left and /right.'),
    }
    for side in _SIDES:
        arguments[f'{side}_port'] = ('', f'Device of the {side} sensor, by serial number.')
        arguments[f'{side}_frame'] = (f'{side}_optical_frame', f'TF frame of the {side} sensor.')
        arguments[f'{side}_emulate'] = ('', f'A scene to emulate instead of the {side} sensor.')
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=default, description=description)
            for name, (default, description) in arguments.items()
        ]
        + [_sensor(side) for side in _SIDES]
    )
