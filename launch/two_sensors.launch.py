# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two sensors, left and right, which publish their detections on one topic.

Each has its own namespace, port and frame. A marker that both see has a TF frame below each, such
as left_mug and right_mug, since TF allows one parent per frame.
"""

from retrolidar_ros.nodes.launching import (
    COMMON,
    check_scene,
    launch_description,
    one_of_several,
    value,
)
from retrolidar_ros.nodes.viewing import viewer

_SIDES = ('left', 'right')


def _sensors(context):
    """Return driver and detector of each side, now that the arguments have values."""
    for side in _SIDES:  # once one runs, what is wrong with the other would leave it behind
        if scene := value(context, f'{side}_emulate'):
            check_scene(context, scene)
    rviz = viewer(context, value(context, f'{_SIDES[0]}_frame'), sensors=_SIDES)
    return rviz + [
        one_of_several(
            context,
            side,
            serial_port=value(context, f'{side}_port'),
            frame_id=value(context, f'{side}_frame'),
            emulate=value(context, f'{side}_emulate'),
            child_frame=side + '_{name}',
        )
        for side in _SIDES
    ]


def generate_launch_description():
    """Return the launch arguments and what they start."""
    text = 'Namespace of both sensors, to which they add /left and /right.'
    arguments = {**COMMON, 'namespace': ('retrolidar', text)}
    for side in _SIDES:
        arguments[f'{side}_port'] = ('', f'Device of the {side} sensor, under /dev/serial/by-id.')
        arguments[f'{side}_frame'] = (f'{side}_optical_frame', f'TF frame of the {side} sensor.')
        arguments[f'{side}_emulate'] = ('', f'Scene to emulate instead of the {side} sensor.')
    return launch_description(arguments, _sensors)
