# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""RViz beside what is launched: the shipped configuration, with its topics and frames."""

import math
import tempfile
from collections.abc import Sequence
from copy import deepcopy
from typing import Any

import yaml
from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.launch_context import LaunchContext
from launch_ros.actions import Node

from retrolidar_ros.nodes.launching import full_namespace, is_on, parameter
from retrolidar_ros.settings.files import load_yaml, shared_file

# From behind and above, where z is up.
_UPRIGHT = {
    'Focal Point': {'X': 1.0, 'Y': 0.0, 'Z': 0.0},
    'Pitch': 0.5,
    'Yaw': math.pi,
    'Distance': 3.0,
}


def viewer(
    context: LaunchContext,
    frame: str,
    *,
    sensors: Sequence[str] = (),
    upright: bool = False,
    landmarks: bool = False,
) -> list[Node]:
    """Return RViz if the launch argument `rviz` is on; RuntimeError if it is not installed.

    All is shown in a TF frame: if upright, z is up, as of a robot's base; else it is a sensor's,
    without its prefix. There may be several sensors, in namespaces below that of the launch, and
    landmarks.
    """
    if not is_on(context, 'rviz'):
        return []
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError as error:
        raise RuntimeError(
            'rviz:=true: RViz is not installed; apt install ros-$ROS_DISTRO-rviz2'
        ) from error
    if not upright:
        frame = parameter(context, 'driver', 'frame_prefix') + frame
    config = _config(full_namespace(context), frame, sensors, upright, landmarks)
    with tempfile.NamedTemporaryFile('w', suffix='.rviz', delete=False) as file:
        yaml.safe_dump(config, file, sort_keys=False)
    return [Node(package='rviz2', executable='rviz2', arguments=['-d', file.name], output='screen')]


def _config(
    namespace: str, frame: str, sensors: Sequence[str], upright: bool, landmarks: bool
) -> dict[str, Any]:
    config: dict[str, Any] = load_yaml(shared_file('config/retrolidar.rviz'))
    manager = config['Visualization Manager']
    manager['Global Options']['Fixed Frame'] = frame
    displays = manager['Displays']
    markers = next(display for display in displays if display['Name'] == 'Markers')
    shown = [display for display in displays if 'Topic' not in display]
    for sensor in sensors or ['']:
        for display in displays:
            if 'Topic' in display:
                space = f'/{namespace}/{sensor}'.rstrip('/')
                shown.append(_moved(display, f'{display["Name"]} {sensor}'.strip(), space))
    if landmarks:
        both = _moved(markers, 'Landmarks', f'/{namespace}/landmarks')
        both['Topic']['Durability Policy'] = 'Transient Local'
        shown.append(both)
    if upright:
        shown.append(_arm(namespace))
        manager['Views']['Current'] |= _UPRIGHT
        next(display for display in shown if display['Name'] == 'Grid').update(
            {'Plane': 'XY', 'Offset': {'X': 2, 'Y': 0, 'Z': 0}}
        )
    manager['Displays'] = shown
    return config


def _moved(display: dict[str, Any], name: str, space: str) -> dict[str, Any]:
    """Return a display of the topic of the same name in another namespace."""
    moved = deepcopy(display) | {'Name': name}
    topic = moved['Topic']
    topic['Value'] = f'{space}/{topic["Value"].rpartition("/")[2]}'
    return moved


def _arm(namespace: str) -> dict[str, Any]:
    topic = {
        'Depth': 1,
        'Durability Policy': 'Transient Local',
        'History Policy': 'Keep Last',
        'Reliability Policy': 'Reliable',
        'Value': f'/{namespace}/robot_description',
    }
    return {
        'Class': 'rviz_default_plugins/RobotModel',
        'Name': 'Emulated arm',
        'Enabled': True,
        'Value': True,
        'Description Source': 'Topic',
        'Description Topic': topic,
    }
