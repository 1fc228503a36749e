# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two sensors, left and right, whose detections come on one topic.

Each has its own namespace, port and frame. A marker that both see has a TF frame below each, such
as left_mug and right_mug, for TF allows a frame but one parent.
"""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

_SHARE = FindPackageShare('retrolidar_ros')
_SIDES = ('left', 'right')


def _sensors(context):
    """Return driver and detector of each side, now that the arguments have values."""

    def value(name):
        return LaunchConfiguration(name).perform(context)

    namespace = value('namespace').strip('/')
    above = f'/{namespace}' if namespace else ''
    groups = []
    for side in _SIDES:
        arguments = {
            'params_file': value('params_file'),
            'marker_file': value('marker_file'),
            'serial_port': value(f'{side}_port'),
            'frame_id': value(f'{side}_frame'),
            'emulate': value(f'{side}_emulate'),
            'child_frame': side + '_{name}',
            'namespace': f'{above}/{side}',
            'markers': f'{above}/markers',
        }
        include = IncludeLaunchDescription(
            PathJoinSubstitution([_SHARE, 'launch', 'retrolidar.launch.py']),
            launch_arguments=arguments.items(),
        )
        groups.append(GroupAction([include]))
    return groups


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
        + [OpaqueFunction(function=_sensors)]
    )
