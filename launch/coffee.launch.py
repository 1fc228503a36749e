# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor, and the node that reports when beans, machine and mug are placed."""

from retrolidar_ros.nodes.launching import (
    MARKERS,
    SENSOR,
    launch_description,
    node,
    number,
    overrides_from,
    parameter,
    preset,
    sensor,
    unset,
    value,
)
from retrolidar_ros.nodes.viewing import viewer
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import load_scene


def _coffee(context):
    """Return sensor and node, now that the arguments have values."""
    parameters = overrides_from(context, 'target_frame', 'max_stddev')
    if 'max_stddev' in parameters:
        parameters['max_stddev'] = number(context, 'max_stddev')
    base, target = value(context, 'emulate_base'), parameter(context, 'coffee', 'target_frame')
    scene = load_scene(name) if (name := value(context, 'emulate')) else Scene()
    if len(scene.sensor.path) > 1:
        # Places in the sensor's frame say nothing while an arm moves it.
        target = parameters['target_frame'] = target or base
    frame = target or parameter(context, 'driver', 'frame_id')
    rviz = viewer(context, frame, upright=bool(target))
    return [*rviz, sensor(emulate_base=target or base), node(context, 'coffee', parameters)]


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        **SENSOR,
        **preset('detector', marker_file=MARKERS),
        **unset('coffee', 'target_frame', 'max_stddev'),
    }
    return launch_description(arguments, _coffee)
