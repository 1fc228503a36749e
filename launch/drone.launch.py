# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor that looks up, and the node that warns when the drone's marker is overdue.

With sensors:=3, three sensors in a triangle on the ground also locate the drone.
"""

import math
import time

from retrolidar_ros.nodes.launching import (
    MARKERS,
    SENSOR,
    launch_description,
    list_argument,
    node,
    number,
    one_of_several,
    parameter,
    preset,
    sensor,
    value,
)
from retrolidar_ros.nodes.viewing import viewer

# Emulated sensors see the same scene, which begins when all of them have started.
_EMULATORS_START_S = 3.0


def _drone(context):
    """Return the nodes, now that the arguments have values."""
    heartbeat = node(context, 'heartbeat', {})
    count = value(context, 'sensors')
    if count not in ('1', '3'):
        raise RuntimeError(f'sensors:={count}: it needs 1 or 3')
    if count == '1':
        rviz = viewer(context, parameter(context, 'driver', 'frame_id'))
        return [*rviz, sensor(), heartbeat]
    ports = list_argument(context, 'ports')
    if len(ports) != (0 if value(context, 'emulate') else 3):
        raise RuntimeError(
            f'ports:={value(context, "ports")}: it needs three, as [a, b, c], or emulate'
        )
    fixed_frame = value(context, 'fixed_frame')
    names = [f'sensor{index}' for index in range(3)]
    rviz = viewer(context, fixed_frame, sensors=names, upright=True, landmarks=True)
    start_s = time.monotonic() + _EMULATORS_START_S
    radius_m = number(context, 'edge') / math.sqrt(3)
    actions, places = [], {}
    for index, name in enumerate(names):
        angle = 2 * math.pi * index / 3
        x, y = radius_m * math.cos(angle), radius_m * math.sin(angle)
        options = f'--at {x:.4f} {y:.4f} 0 --seed {index} --start {start_s}'
        frame = f'{name}_optical_frame'
        places[frame] = (x, y)
        own = {
            'serial_port': ports[index] if ports else '',
            'frame_id': frame,
            'emulate': value(context, 'emulate'),
            'emulate_options': options,
            'publish_tf': 'false',
        }
        actions.append(one_of_several(context, name, **own))
    _send_places(context, places)
    parameters = {
        'fixed_frame': fixed_frame,
        'marker_file': value(context, 'marker_file'),
        'acceleration': number(context, 'acceleration'),
    }
    return [*rviz, *actions, node(context, 'landmarks', parameters), heartbeat]


def _send_places(context, places):
    """Send static transforms of the sensors, by frame: x and y in the fixed frame [m]."""
    from geometry_msgs.msg import TransformStamped
    from launch_ros.ros_adapters import get_ros_node
    from tf2_ros import StaticTransformBroadcaster

    transforms = []
    for frame, (x, y) in places.items():
        # It looks up: its frame has x, y and z where the fixed one has them.
        transform = TransformStamped(child_frame_id=value(context, 'frame_prefix') + frame)
        transform.header.frame_id = value(context, 'fixed_frame')
        transform.transform.translation.x, transform.transform.translation.y = x, y
        transforms.append(transform)
    StaticTransformBroadcaster(get_ros_node(context)).sendTransform(transforms)


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        **SENSOR,
        'emulate_base': ('', SENSOR['emulate_base'][1]),
        **preset('detector', marker_file=MARKERS),
        'sensors': ('1', 'Number of sensors: 1, or 3 to locate the drone.'),
        'ports': ('[]', 'Devices of three sensors, as [/dev/a, /dev/b, /dev/c].'),
        'edge': ('0.4', 'Edge of the triangle of sensors [m]; the first is on its x axis.'),
        'fixed_frame': ('ground', 'TF frame in the middle of the triangle, with z up.'),
        **preset('landmarks', acceleration='0.04'),
    }
    return launch_description(arguments, _drone)
