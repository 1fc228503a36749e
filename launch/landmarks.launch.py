# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor, and the node that places markers in a fixed frame, or a robot among them."""

from retrolidar_ros.nodes.launching import (
    MARKERS,
    SENSOR,
    is_on,
    launch_description,
    node,
    overrides_from,
    parameter,
    preset,
    sensor,
    unset,
)
from retrolidar_ros.nodes.viewing import viewer

_FILES_AND_FRAMES = ('fixed_frame', 'marker_file', 'load_file', 'save_file', 'base_frame')


def _landmarks(context):
    """Return sensor and node, now that the arguments have values."""
    parameters = overrides_from(context, *_FILES_AND_FRAMES)
    parameters['localize'] = is_on(context, 'localize')
    fixed_frame = parameter(context, 'landmarks', 'fixed_frame')
    rviz = viewer(context, fixed_frame, upright=True, landmarks=True)
    return [*rviz, sensor(emulate_base=fixed_frame), node(context, 'landmarks', parameters)]


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        **SENSOR,
        **preset('detector', marker_file=MARKERS),
        **unset('landmarks', 'fixed_frame', 'load_file', 'save_file', 'base_frame'),
        **preset('landmarks', localize='false'),
    }
    return launch_description(arguments, _landmarks)
