# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters whose defaults live in one place, `config/retrolidar.yaml`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
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

from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import (
    load_parameter_defaults,
    load_parameter_names,
    load_yaml,
)


class Parameters:
    """Declares the parameters of a node, each with the default of the shipped file.

    Only those declared `live` may be set while the node runs.
    """

    def __init__(self, node: Node, kind: str) -> None:
        """Read the defaults of the nodes of one `kind`, such as driver."""
        self.values: dict[str, Any] = {}
        """Of all parameters declared so far."""
        self._node = node
        self._defaults = load_parameter_defaults(shared_file('config/retrolidar.yaml'), kind)
        self._checks: dict[str, Callable[[Any], Any]] = {}
        for service in node.services:
            if '/set_parameters' in service.srv_name:
                service.callback = _refusing(service.callback)

    def text(
        self, name: str, description: str, among: tuple[str, ...] = (), *, live: bool = False
    ) -> None:
        """Declare a string; ValueError if it is not `among`."""
        constraints = f'one of {", ".join(among)}' if among else ''

        def check(value: Any) -> str:
            if among and value not in among:
                raise ValueError(f'{name}: {value!r} is not {constraints}')
            return str(value)

        self._declare(name, description, check, live, additional_constraints=constraints)

    def flag(self, name: str, description: str, *, live: bool = False) -> None:
        """Declare a boolean."""
        self._declare(name, description, bool, live)

    def integer(
        self, name: str, description: str, minimum: int, maximum: int, *, live: bool = False
    ) -> None:
        """Declare an integer within limits."""
        limits = IntegerRange(from_value=minimum, to_value=maximum, step=0)
        self._declare(name, description, int, live, integer_range=[limits])

    def number(
        self, name: str, description: str, minimum: float, maximum: float, *, live: bool = False
    ) -> None:
        """Declare a float within limits."""
        limits = FloatingPointRange(from_value=minimum, to_value=maximum, step=0.0)
        self._declare(name, description, float, live, floating_point_range=[limits])

    def integers(
        self, name: str, description: str, minimum: int, maximum: int, *, live: bool = False
    ) -> None:
        """Declare a list of integers, which may be empty; ValueError if one exceeds the limits."""
        constraints = f'integers of {minimum} to {maximum}, or []'

        def check(value: Any) -> list[int]:
            if len(numbers := _listed(name, value)) > maximum - minimum + 1:
                most = maximum - minimum + 1
                raise ValueError(f'{name}: {len(numbers)} numbers; {most} are the most')
            for number in numbers:
                if isinstance(number, bool) or not isinstance(number, int):
                    raise ValueError(f'{name}: {number!r} is not a whole number')
                if not minimum <= number <= maximum:
                    raise ValueError(f'{name}: {number} is not within {minimum} to {maximum}')
            return list(value)

        self._declare_list(
            name, description, Parameter.Type.INTEGER_ARRAY, check, live, constraints
        )

    def texts(self, name: str, description: str) -> None:
        """Declare a list of strings, which may be empty."""

        def check(value: Any) -> list[str]:
            for one in _listed(name, value):
                if not isinstance(one, str) or not one:
                    raise ValueError(f'{name}: {one!r} is not a text')
            return list(value)

        self._declare_list(
            name, description, Parameter.Type.STRING_ARRAY, check, False, 'texts, or []'
        )

    def follow(self, apply: Callable[[dict[str, Any]], None]) -> None:
        """Let live parameters be set.

        Parameters
        ----------
        apply : callable
            Gets the new values of all parameters; a ValueError rejects them, with its text as
            the reason.
        """

        def change(parameters: Sequence[Parameter]) -> SetParametersResult:
            values = dict(self.values)
            try:
                for parameter in parameters:
                    if parameter.name in self._checks:
                        check = self._checks[parameter.name]
                        values[parameter.name] = check(parameter.value)
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
        known_elsewhere = load_parameter_names(shared_file('config/retrolidar.yaml'))
        for name in self._node._parameter_overrides:
            if self._node.has_parameter(name) or name in known_elsewhere:
                continue
            of_topic = name.startswith('qos_overrides.')
            near = get_close_matches(name, self._topic_names() if of_topic else self._defaults, n=1)
            if (of_topic or not near) and name in _meant_for_all():
                continue
            known = 'qos_overrides.TOPIC.publisher.depth' if of_topic else ', '.join(self._defaults)
            hint = f'did you mean {near[0]}?' if near else f'known: {known}'
            self._node.get_logger().warning(f'parameter {name} is unknown; {hint}')

    def _topic_names(self) -> list[str]:
        return [name for name in self._node._parameters if name.startswith('qos_overrides.')]

    def _declare(
        self,
        name: str,
        description: str,
        check: Callable[[Any], Any],
        live: bool,
        **constraints: Any,
    ) -> None:
        descriptor = ParameterDescriptor(description=description, read_only=not live, **constraints)
        parameter = self._node.declare_parameter(name, self._defaults[name], descriptor)
        self._checks[name] = check
        self.values[name] = check(parameter.value)

    def _declare_list(
        self,
        name: str,
        description: str,
        kind: Parameter.Type,
        check: Callable[[Any], Any],
        live: bool,
        constraints: str,
    ) -> None:
        # An empty list has no type of its own: as a default it is taken for bytes, from a file it
        # comes without a value, and from the tools as a list of booleans. So the type is left
        # open and checked here, and an empty list is given the type afterwards.
        texts = {'description': description, 'additional_constraints': constraints}
        open_type = ParameterDescriptor(dynamic_typing=True, **texts)
        value = self._node.declare_parameter(name, self._defaults[name], open_type).value
        values = check([] if value is None else value)
        if not values:
            self._node.set_parameters([Parameter(name, kind, [])])
        self._node.set_descriptor(
            name, ParameterDescriptor(dynamic_typing=True, read_only=not live, **texts)
        )
        self._checks[name] = check
        self.values[name] = values


def _refusing(change: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
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


def _listed(name: str, value: Any) -> list[Any]:
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError(f'{name}: {value!r} is not a list')
    return list(value)
