# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of nodes: their declaration in ROS, and changes while a node runs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from retrolidar_ros.settings.parameter import Parameter as Declared
from retrolidar_ros.settings.parameter import declared
from retrolidar_ros.settings.yaml_files import load_yaml


class Parameters:
    """Declares the parameters of a node. Only the live ones may be set while it runs."""

    def __init__(self, node: Node, kind: str) -> None:
        """Declare those of one `kind` of nodes; ValueError if a value is not allowed."""
        self._node = node
        self._declared = declared()[kind]
        # rclpy makes the parameter services itself, so they can only be wrapped here.
        for service in node.services:
            if '/set_parameters' in service.srv_name:
                service.callback = _reject_unknown_types(service.callback)
        self.values: dict[str, Any] = {
            name: self._declare_list(name, one)
            if isinstance(one.default, list)
            else self._declare(name, one)
            for name, one in self._declared.items()
        }

    def _declare(self, name: str, one: Declared) -> Any:
        descriptor = ParameterDescriptor(read_only=not one.is_live, **_texts(one))
        if one.limits and isinstance(one.default, int):
            low, high = map(int, one.limits)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high)]
        elif one.limits:
            least, most = one.limits
            descriptor.floating_point_range = [FloatingPointRange(from_value=least, to_value=most)]
        return one.check(name, self._node.declare_parameter(name, one.default, descriptor).value)

    def _declare_list(self, name: str, one: Declared) -> list[Any]:
        # An empty list has no type of its own: as a default it is taken for bytes, from a file it
        # comes without a value, and from the tools as a list of booleans. So the type is left
        # open and checked here, and an empty list is given the type afterwards.
        open_type = ParameterDescriptor(dynamic_typing=True, **_texts(one))
        value = self._node.declare_parameter(name, one.default, open_type).value
        checked: list[Any] = one.check(name, [] if value is None else value)
        if not checked:
            kind = Parameter.Type.INTEGER_ARRAY if one.limits else Parameter.Type.STRING_ARRAY
            self._node.set_parameters([Parameter(name, kind, [])])
        descriptor = ParameterDescriptor(
            dynamic_typing=True, read_only=not one.is_live, **_texts(one)
        )
        self._node.set_descriptor(name, descriptor)
        return checked

    def follow(self, apply: Callable[[dict[str, Any]], None]) -> None:
        """Let live parameters be set.

        `apply` gets the new values of all; its ValueError rejects them, and tells why.
        """

        def change(parameters: Sequence[Parameter]) -> SetParametersResult:
            values = dict(self.values)
            try:
                for parameter in parameters:
                    if one := self._declared.get(parameter.name):
                        values[parameter.name] = one.check(parameter.name, parameter.value)
                apply(values)
            except ValueError as error:
                return SetParametersResult(successful=False, reason=str(error))
            self.values = values
            return SetParametersResult(successful=True)

        self._node.add_on_set_parameters_callback(change)

    def warn_of_unknown(self) -> None:
        """Log a warning for each parameter set for this node that it does not have.

        Call it when all is declared, the overrides of topics included. `/**:` addresses other
        nodes, too, and so do the parameters of several nodes in one process.
        """
        # Not public; what is, automatically_declare_parameters_from_overrides, would declare each.
        for name in self._node._parameter_overrides:
            if self._node.has_parameter(name) or any(name in one for one in declared().values()):
                continue
            of_topic = name.startswith('qos_overrides.')
            near = get_close_matches(name, self._topic_names() if of_topic else self._declared, n=1)
            if (of_topic or not near) and name in _meant_for_all():
                continue
            known = 'qos_overrides.TOPIC.publisher.depth' if of_topic else ', '.join(self._declared)
            hint = f'did you mean {near[0]}?' if near else f'known: {known}'
            self._node.get_logger().warning(f'parameter {name} is unknown; {hint}')

    def _topic_names(self) -> list[str]:
        prefix = 'qos_overrides'
        return [f'{prefix}.{name}' for name in self._node.get_parameters_by_prefix(prefix)]


def _texts(one: Declared) -> dict[str, str]:
    """Return the texts of a descriptor."""
    return {'description': one.description, 'additional_constraints': one.constraints()}


def _reject_unknown_types(change: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Return a service that refuses unknown types; rclpy's ends the node."""

    def answer(request: Any, response: Any) -> Any:
        for parameter in request.parameters:
            if parameter.value.type > ParameterType.PARAMETER_STRING_ARRAY:
                text = f'{parameter.name}: there is no type {parameter.value.type}'
                refused = SetParametersResult(successful=False, reason=text)
                if hasattr(response, 'results'):
                    response.results = [refused] * len(request.parameters)
                else:  # of those that are set all at once
                    response.result = refused
                return response
        return change(request, response)

    return answer


def check_frame_id(name: str, value: str) -> str:
    """Return the name of a TF frame; ValueError for one that TF does not accept."""
    if not value:
        raise ValueError(f'{name} is empty; TF needs a name')
    if value.startswith('/'):
        raise ValueError(
            f'{name}: {value!r} begins with a slash, which tf2 refuses; write {value.lstrip("/")!r}'
        )
    return value


def _meant_for_all() -> set[str]:
    """Return the parameters that files on the command line set for all nodes."""
    names: set[str] = set()
    for option, value in pairwise(sys.argv):
        if option == '--params-file':
            with suppress(OSError, ValueError, AttributeError):
                for node, content in load_yaml(Path(value)).items():
                    if str(node).strip('/') in ('*', '**'):
                        names |= {str(name) for name in content['ros__parameters']}
    return names
