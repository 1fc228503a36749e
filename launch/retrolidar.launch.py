# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Driver and detector of one sensor, or of an emulated one with `emulate:=SCENE`."""

import os
import shlex
import sys
import tempfile
import time

from launch.actions import ExecuteProcess, OpaqueFunction, Shutdown

from retrolidar_ros.nodes.launching import (
    EMULATED,
    SENSOR,
    full_namespace,
    is_on,
    launch_description,
    node,
    overrides_from,
    parameter,
    unset,
    value,
)
from retrolidar_ros.nodes.viewing import viewer

# Launch arguments that go before what the parameter file says.
_OVERRIDES = {
    'driver': ('serial_port', 'protocol', 'frame_id', 'autostart'),
    'detector': ('marker_file', 'child_frame', 'publish_tf', 'tf_source'),
}
# The scene begins when the arm knows that there is no other one.
_START_S = 5.0


def _end(context):
    """Return the end of the launch, unless it is ending; a second request can hang it."""
    return [] if context.is_shutdown else [Shutdown(reason='the emulated sensor has ended')]


def _link(context):
    """Return a path for the port of an emulated sensor that no other launch or namespace has."""
    path = full_namespace(context).replace('/', '_')
    return os.path.join(tempfile.gettempdir(), f'retrolidar_{os.getpid()}_{path}')


def _nodes(context):
    """Return the processes to start, now that the arguments have values."""
    parameters = overrides_from(context, *(name for names in _OVERRIDES.values() for name in names))
    actions = viewer(context, parameter(context, 'driver', 'frame_id'))
    if scene := value(context, 'emulate'):
        # The driver opens the emulator's port as it would open that of a sensor with our protocol.
        port = parameters.setdefault('serial_port', _link(context))
        parameters['protocol'] = EMULATED
        emulator = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate', scene]
        if base := value(context, 'emulate_base'):
            start_s = time.monotonic() + _START_S
            emulator += ['--start', str(start_s)]
            arm = {'scene': scene, 'start': start_s, 'fixed_frame': base}
            actions.append(node(context, 'emulated_arm', arm))
        emulator += shlex.split(value(context, 'emulate_options'))
        actions.append(
            ExecuteProcess(
                cmd=[*emulator, '--port-link', port],
                name='emulator',
                output='screen',
                on_exit=OpaqueFunction(function=_end),
            )
        )
    for name in {'autostart', 'publish_tf'} & parameters.keys():
        parameters[name] = is_on(context, name)
    remappings = [('markers', value(context, 'markers'))]
    if is_on(context, 'single_process'):
        return [*actions, node(context, 'reader', parameters, remappings=remappings)]
    for name, names in _OVERRIDES.items():
        own = {key: parameters[key] for key in names if key in parameters}
        options = {'remappings': remappings} if name == 'detector' else {}
        actions.append(node(context, name, own, **options))
    return actions


def generate_launch_description():
    """Return the launch arguments and what they start."""
    arguments = {
        **SENSOR,
        **unset('detector', 'child_frame', 'publish_tf', 'tf_source'),
        'markers': ('markers', 'Topic of the detections.'),
        'emulate_options': ('', 'More options of `retrolidar emulate`, such as --seed 3.'),
    }
    return launch_description(arguments, _nodes)
