# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One host of several in a hall: its sensors in one process, and a discovery server for all hosts.

On one host: ros2 launch retrolidar_ros hall.launch.py serve:=true ports:=[...] names:=[...]
On the rest: ros2 launch retrolidar_ros hall.launch.py server:=HOST:11811 ports:=[...] names:=[...]
"""

from launch.actions import ExecuteProcess, SetEnvironmentVariable

from retrolidar_ros.nodes.launching import (
    COMMON,
    is_on,
    launch_description,
    list_argument,
    node,
    overrides_from,
    parameter,
    preset,
    value,
)
from retrolidar_ros.nodes.parameters import optical_frame, sensor_names
from retrolidar_ros.nodes.viewing import viewer


def _host(context):
    """Return the server, if it is here, and the reader."""
    actions = []
    server = value(context, 'server')
    if is_on(context, 'serve'):
        port = server.rpartition(':')[2] or '11811'
        server = server or f'127.0.0.1:{port}'
        command = ['fast-discovery-server', '-i', '0', '-l', '0.0.0.0', '-p', port]
        actions.append(ExecuteProcess(cmd=command, name='server', output='screen', respawn=True))
    if server:
        actions.append(SetEnvironmentVariable('ROS_DISCOVERY_SERVER', server))
    parameters = overrides_from(context, 'marker_file', 'protocol')
    parameters |= {
        name: items for name in ('ports', 'names') if (items := list_argument(context, name))
    }
    names = sensor_names(parameters.get('names', []), parameters.get('ports', []))
    frame = optical_frame(names[0]) if names else parameter(context, 'driver', 'frame_id')
    actions += viewer(context, frame, sensors=names)
    remappings = [('markers', value(context, 'markers'))] if value(context, 'markers') else []
    return [*actions, node(context, 'reader', parameters, remappings=remappings)]


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        **COMMON,
        **preset('reader', ports='[]', names='[]'),
        'namespace': ('retrolidar', 'Namespace of all sensors, to which each adds its name.'),
        'markers': ('', 'One topic for all detections; empty = one for each sensor.'),
        'server': ('', 'Discovery server, as HOST:PORT; empty = none, or that of serve.'),
        'serve': ('false', 'Whether the discovery server runs on this host.'),
    }
    arguments.pop('single_process')  # it is one
    arguments.pop('autostart')
    return launch_description(arguments, _host)
