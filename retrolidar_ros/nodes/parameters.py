# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes: their spec in ROS, and changes while a node runs."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from retrolidar_ros.settings.parameter import Parameter as Declared
from retrolidar_ros.settings.parameter import declared

NAME = '{name}'  # what stands for a name in the parameter `child_frame`


class Parameters:
    """Declares the parameters of a node. Only the live ones may be set while it runs."""

    def __init__(self, node: Node, kind: str) -> None:
        """Declare those of one `kind` of nodes; ValueError if a value is not allowed."""
        self._node = node
        self._declared = declared()[kind]
        self.values: dict[str, Any] = {
            name: self._declare(name, spec) for name, spec in self._declared.items()
        }
        self._warn_of_misspelled()

    def _declare(self, name: str, spec: Declared) -> Any:
        # The type is open until the value is checked: 50 does for 50.0, and an empty list has no
        # type of its own. As a default it is taken for bytes, from a file it comes without a value,
        # and from the tools as a list of booleans; so that of a list stays open.
        open_type = ParameterDescriptor(dynamic_typing=True)
        given = self._node.declare_parameter(name, spec.default, open_type).value
        is_list = isinstance(spec.default, list)
        value = spec.check(name, [] if is_list and given is None else given)
        kind = Parameter.Type.from_parameter_value(value)
        if value == []:
            kind = Parameter.Type.INTEGER_ARRAY if spec.limits else Parameter.Type.STRING_ARRAY
        if is_list or not isinstance(given, type(value)):
            self._node.set_parameters([Parameter(name, kind, value)])
        descriptor = ParameterDescriptor(
            type=kind.value,
            description=spec.description,
            additional_constraints=spec.constraints(),
            read_only=not spec.is_live,
            dynamic_typing=is_list,
        )
        if spec.limits and not is_list:
            low, high = spec.limits
            if isinstance(value, int):
                descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(from_value=low, to_value=high)
                ]
        self._node.set_descriptor(name, descriptor)
        return value

    def follow(self, apply: Callable[[dict[str, Any]], None] = lambda _: None) -> None:
        """Let live parameters be set; a ValueError of `apply` rejects the values of all."""

        def change(parameters: Sequence[Parameter]) -> SetParametersResult:
            values = dict(self.values)
            try:
                for parameter in parameters:
                    if spec := self._declared.get(parameter.name):
                        values[parameter.name] = spec.check(parameter.name, parameter.value)
                apply(values)
            except ValueError as error:
                return SetParametersResult(successful=False, reason=str(error))
            self.values = values
            return SetParametersResult(successful=True)

        self._node.add_on_set_parameters_callback(change)

    def _warn_of_misspelled(self) -> None:
        """Warn of each parameter that was set, and that is nearly one of this node."""
        # Not public; what is, automatically_declare_parameters_from_overrides, would declare each.
        for name in self._node._parameter_overrides:
            of_others = any(name in declarations for declarations in declared().values())
            near = get_close_matches(name, self._declared, n=1)
            if near and not of_others and not name.startswith('qos_overrides.'):
                self._node.get_logger().warning(
                    f'parameter {name} is unknown; did you mean {near[0]}?'
                )


def sensor_names(names: Sequence[str], ports: Sequence[str]) -> list[str]:
    """Return the names of the sensors of one process, by default numbered."""
    return list(names) or [f'sensor{index}' for index in range(len(ports))]


def optical_frame(name: str) -> str:
    """Return the TF frame of one of several sensors."""
    return f'{name}_optical_frame'


def check_frame_id(name: str, value: str) -> str:
    """Return the name of a TF frame; ValueError for one that TF does not accept."""
    if not value:
        raise ValueError(f'{name} is empty; TF needs a name')
    if value.startswith('/'):
        raise ValueError(
            f'{name}: {value!r} begins with a slash, which tf2 refuses; write {value.lstrip("/")!r}'
        )
    return value


def child_frame_of(values: Mapping[str, Any]) -> str:
    """Return the TF frames of what a node sends, with prefix and NAME; ValueError as above."""
    child_frame = check_frame_id('child_frame', values['frame_prefix'] + values['child_frame'])
    if child_frame.count(NAME) != 1:
        raise ValueError(f'child_frame: {child_frame!r} needs {NAME} once')
    return child_frame
