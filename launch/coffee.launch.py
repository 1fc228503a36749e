# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor, and the node that reports when beans, machine and mug are placed."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from retrolidar_ros.nodes.launching import MARKERS, SENSOR, declared, given, node, number, sensor


def _coffee(context):
    """Return sensor and node, now that the arguments have values."""
    parameters = given(context, 'target_frame', 'max_stddev')
    if 'max_stddev' in parameters:
        parameters['max_stddev'] = number(context, 'max_stddev')
    return [sensor(), node(context, 'coffee', parameters)]


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        **SENSOR,
        'marker_file': (MARKERS, 'YAML file of the known markers.'),
        'target_frame': ('', 'Frame of the poses; empty = as in the parameter file.'),
        'max_stddev': ('', 'Largest standard deviation [m]; empty = as in the parameter file.'),
    }
    return LaunchDescription([*declared(arguments), OpaqueFunction(function=_coffee)])
