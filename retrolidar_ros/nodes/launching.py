# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Shared by all launch files: the arguments of a sensor, and the start of a node.

An error ends the setup of a launch, but not the processes started by then. So all arguments are
checked before the first one starts.
"""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import yaml
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    GroupAction,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueFunction,
)
from launch.events import matches_action
from launch.events.process import ProcessExited, ShutdownProcess
from launch.launch_context import LaunchContext
from launch.launch_description_entity import LaunchDescriptionEntity
from launch.logging import get_logger
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from retrolidar_ros.detector.parameters import known_markers
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.settings.files import shared_file
from retrolidar_ros.settings.parameter import declared, file_sections, file_values, misspelled

PARAMETERS = str(shared_file('config/retrolidar.yaml'))
MARKERS = str(shared_file('config/markers.yaml'))
_AS_IN_FILE = 'If it is not given, the parameter file decides.'


def unset(kind: str, *names: str) -> dict[str, tuple[Any, str]]:
    """Return launch arguments that override parameters of a node if they are not empty."""
    described = preset(kind, **dict.fromkeys(names, ''))
    return {name: ('', f'{text} {_AS_IN_FILE}') for name, (_, text) in described.items()}


def preset(kind: str, **defaults: Any) -> dict[str, tuple[Any, str]]:
    """Return launch arguments that override parameters of a node, by these values if not given."""
    return {name: (default, declared()[kind][name].summary()) for name, default in defaults.items()}


COMMON: dict[str, tuple[Any, str]] = {
    'params_file': (PARAMETERS, 'File with the parameters of all nodes.'),
    **unset('detector', 'marker_file'),
    **unset('driver', 'protocol', 'autostart'),
    'frame_prefix': ('', 'Prefix of all TF frames that are sent, such as robot1/.'),
    'single_process': ('false', 'Whether driver and detector share a process, the reader.'),
    'log_level': ('info', 'Level of the log: debug, info, warn, error or fatal.'),
    'use_sim_time': ('', f'Whether nodes take their time from /clock. {_AS_IN_FILE}'),
    'respawn': ('true', 'Whether a node that fails is started again.'),
    'respawn_delay': ('2.0', 'Delay before a failed node is started again [s].'),
    'rviz': ('false', 'Whether RViz starts, too.'),
}
"""Launch arguments of every launch file: default and description."""
SENSOR: dict[str, tuple[Any, str]] = {
    **COMMON,
    **unset('driver', 'serial_port', 'frame_id'),
    'namespace': ('retrolidar', 'Namespace of nodes and topics.'),
    'emulate': ('', 'Scene to emulate instead of a sensor: a name, such as coffee, or a file.'),
    'emulate_base': (
        'base_link',
        'Base frame of an arm that moves the emulated sensor; empty = no arm.',
    ),
}
"""Those of every launch file for one sensor."""
EMULATED = 'retrolidar'
"""Protocol of emulated sensors."""
_MIN_DELAY_S = 0.1
_MISCONFIGURED = 2  # exit code of a node with wrong parameters or files; a restart would not help
_LEVELS = ('debug', 'info', 'warn', 'error', 'fatal')


def launch_description(
    arguments: dict[str, tuple[Any, str]],
    start: Callable[[LaunchContext], list[LaunchDescriptionEntity]],
) -> LaunchDescription:
    """Return launch arguments, by name, and what `start` returns once they have values."""
    declared_arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in arguments.items()
    ]

    def checked(context: LaunchContext) -> list[LaunchDescriptionEntity]:
        # ValueError if a file cannot be used.
        known_markers({'marker_file': parameter(context, 'detector', 'marker_file')})
        if 'emulate' in arguments and (scene := value(context, 'emulate')):
            check_scene(context, scene)
        return start(context)

    return LaunchDescription([*declared_arguments, OpaqueFunction(function=checked)])


def value(context: LaunchContext, name: str) -> str:
    """Return the value of a launch argument."""
    text: str = LaunchConfiguration(name).perform(context)
    return text


def overrides_from(context: LaunchContext, *names: str) -> dict[str, Any]:
    """Return those launch arguments that have a value, which goes before the parameter file's."""
    return {name: text for name in names if (text := value(context, name))}


def is_on(context: LaunchContext, name: str) -> bool:
    """Return a launch argument as a boolean; RuntimeError if it is none."""
    text = value(context, name).lower()
    if text not in ('true', 'false', '1', '0'):
        raise RuntimeError(f'{name}:={text}: it needs true or false')
    return text in ('true', '1')


def number(context: LaunchContext, name: str) -> float:
    """Return a launch argument as a number; RuntimeError if it is none, or negative."""
    text = value(context, name)
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0 <= number < math.inf:
        raise RuntimeError(f'{name}:={text}: it needs a number, 0 or above')
    return number


def list_argument(context: LaunchContext, name: str) -> list[Any]:
    """Return a launch argument as a list; RuntimeError if it is none, or has booleans."""
    text = value(context, name)
    try:
        items = yaml.safe_load(text)
    except yaml.YAMLError:
        items = None
    if not isinstance(items, list):
        raise RuntimeError(f'{name}:={text}: it needs a list, as [a, b]')
    for item in items:
        # A parameter file takes y and n for booleans, which the YAML of Python does not.
        if isinstance(item, bool) or str(item).lower() in ('y', 'n'):
            raise RuntimeError(f'{name}:={text}: {item} is true or false in YAML; use longer names')
    return items


def _file_values(context: LaunchContext, kind: str) -> dict[str, Any]:
    """Return what the parameter file says of a node; RuntimeError if it is none."""
    try:
        path = Path(value(context, 'params_file'))
        _warn_of_misspelled(path)
        return file_values(path, kind, f'/{_joined(full_namespace(context), kind)}')
    except (OSError, ValueError) as error:
        raise RuntimeError(f'params_file:={error}') from error


@cache
def _warn_of_misspelled(path: Path) -> None:
    """Warn once of each section of a parameter file that is nearly for a node of the package."""
    for hint in misspelled(file_sections(path)):
        get_logger('retrolidar_ros').warning(f'params_file:={path}: {hint}')


def parameter(context: LaunchContext, kind: str, name: str) -> Any:
    """Return a launch argument, if there is one, or the parameter of a node, as the file has it."""
    default = declared()[kind][name].default
    given = context.launch_configurations.get(name)
    return given or _file_values(context, kind).get(name, default)


def node(
    context: LaunchContext, executable: str, parameters: dict[str, Any], **options: Any
) -> Node:
    """Return a node of the package, with parameters that go before those of the file."""
    parameters = dict(parameters)
    _file_values(context, executable)  # rcl would ignore a file that is none
    if 'marker_file' in declared()[executable]:
        known_markers({'marker_file': parameter(context, executable, 'marker_file')})
    level = value(context, 'log_level')
    if level.rpartition(':=')[2].lower() not in _LEVELS:
        raise RuntimeError(f'log_level:={level}: it needs one of {", ".join(_LEVELS)}')
    if value(context, 'use_sim_time'):
        parameters['use_sim_time'] = is_on(context, 'use_sim_time')
    parameters |= overrides_from(context, 'frame_prefix')
    return Node(
        package='retrolidar_ros',
        executable=executable,
        namespace=value(context, 'namespace'),
        parameters=[value(context, 'params_file'), *([parameters] if parameters else [])],
        ros_arguments=['--log-level', level],
        respawn=is_on(context, 'respawn'),
        # A misconfigured node is removed within this delay.
        respawn_delay=max(number(context, 'respawn_delay'), _MIN_DELAY_S),
        on_exit=_on_exit,
        output='screen',
        **options,
    )


def _on_exit(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return actions that keep a misconfigured node from being respawned."""
    if event.returncode != _MISCONFIGURED or context.is_shutdown:
        return []
    return [
        LogInfo(msg=f'{event.process_name} is misconfigured, see above: it is not started again'),
        EmitEvent(event=ShutdownProcess(process_matcher=matches_action(event.action))),
    ]


def check_scene(context: LaunchContext, scene: str) -> None:
    """Raise RuntimeError or ConfigError if a scene cannot be emulated."""
    load_scene(scene)
    if (protocol := value(context, 'protocol')) not in ('', EMULATED):
        raise RuntimeError(f'protocol:={protocol}: an emulated sensor speaks {EMULATED}')


def sensor(**arguments: Any) -> IncludeLaunchDescription:
    """Return one sensor, by retrolidar.launch.py, with arguments before those of this launch."""
    arguments = {name: LaunchConfiguration(name) for name in SENSOR} | arguments
    arguments['rviz'] = 'false'  # the launch file that includes it starts RViz
    return IncludeLaunchDescription(
        str(shared_file('launch/retrolidar.launch.py')), launch_arguments=arguments.items()
    )


def one_of_several(context: LaunchContext, name: str, **own: str) -> GroupAction:
    """Return a sensor in a namespace of its own, whose detections come on the topic of all."""
    # The namespace is relative to one that may have been pushed, and the topic is not.
    namespace = value(context, 'namespace')
    common = {argument: value(context, argument) for argument in COMMON}
    common |= {'namespace': _joined(namespace, name), 'emulate_base': ''}
    common['markers'] = f'/{full_namespace(context)}/markers'
    return GroupAction([sensor(**common | own)])


def full_namespace(context: LaunchContext) -> str:
    """Return the namespace of the launch, below one that may have been pushed."""
    pushed = context.launch_configurations.get('ros_namespace', '')
    return _joined(pushed, value(context, 'namespace'))


def _joined(*parts: str) -> str:
    return '/'.join(part for text in parts if (part := text.strip('/')))
