# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One sensor that looks up, and the node that warns when the drone's marker is overdue."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from retrolidar_ros.nodes.launching import MARKERS, SENSOR, declared, node, sensor


def _heartbeat(context):
    """Return the node, now that the arguments have values."""
    return [node(context, 'heartbeat', {})]


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {**SENSOR, 'marker_file': (MARKERS, 'YAML file of the known markers.')}
    return LaunchDescription(
        [*declared(arguments), sensor(list(SENSOR)), OpaqueFunction(function=_heartbeat)]
    )
