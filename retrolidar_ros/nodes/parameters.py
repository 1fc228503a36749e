# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters whose defaults live in one place, `config/retrolidar.yaml`."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from difflib import get_close_matches
from functools import partial
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
        # A service cannot be wrapped otherwise: rclpy makes those of parameters itself.
        for service in node.services:
            if '/set_parameters' in service.srv_name:
                service.callback = _reject_unknown_types(service.callback)

    def declare(
        self,
        name: str,
        description: str,
        *limits: float,
        among: tuple[str, ...] = (),
        live: bool = False,
    ) -> None:
        """Declare a parameter of the type of its default; ValueError if its value is impossible.

        A number has limits. A list may be empty; it holds whole numbers within limits if there are
        any, and texts otherwise. A text may have to be `among` some.
        """
        default = self._defaults[name]
        if isinstance(default, list):
            self._declare_list(name, description, limits, live)
            return
        kind, constraints = type(default), f'one of {", ".join(among)}' if among else ''

        def check(value: Any) -> Any:
            if among and value not in among:
                raise ValueError(f'{name}: {value!r} is not {constraints}')
            return kind(value)

        ranges: dict[str, Any] = {}
        if kind is int:
            least, most = map(int, limits)
            ranges['integer_range'] = [IntegerRange(from_value=least, to_value=most)]
        elif kind is float:
            low, high = limits
            ranges['floating_point_range'] = [FloatingPointRange(from_value=low, to_value=high)]
        descriptor = ParameterDescriptor(
            description=description,
            additional_constraints=constraints,
            read_only=not live,
            **ranges,
        )
        self._checks[name] = check
        self.values[name] = check(self._node.declare_parameter(name, default, descriptor).value)

    def _declare_list(
        self, name: str, description: str, limits: tuple[float, ...], live: bool
    ) -> None:
        # An empty list has no type of its own: as a default it is taken for bytes, from a file it
        # comes without a value, and from the tools as a list of booleans. So the type is left
        # open and checked here, and an empty list is given the type afterwards.
        kind, held = Parameter.Type.STRING_ARRAY, 'texts'
        if limits:
            kind, held = Parameter.Type.INTEGER_ARRAY, f'integers of {limits[0]} to {limits[1]}'
        texts = {'description': description, 'additional_constraints': f'{held}, or []'}
        open_type = ParameterDescriptor(dynamic_typing=True, **texts)
        value = self._node.declare_parameter(name, self._defaults[name], open_type).value
        self._checks[name] = partial(_checked_list, name, limits)
        self.values[name] = self._checks[name]([] if value is None else value)
        if not self.values[name]:
            self._node.set_parameters([Parameter(name, kind, [])])
        self._node.set_descriptor(
            name, ParameterDescriptor(dynamic_typing=True, read_only=not live, **texts)
        )

    def follow(self, apply: Callable[[dict[str, Any]], None]) -> None:
        """Let live parameters be set.

        `apply` gets the new values of all; its ValueError rejects them, and tells why.
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
        # Not public; what is, automatically_declare_parameters_from_overrides, would declare each.
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
        prefix = 'qos_overrides'
        return [f'{prefix}.{name}' for name in self._node.get_parameters_by_prefix(prefix)]


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


def _checked_list(name: str, limits: tuple[float, ...], value: Any) -> list[Any]:
    """Return a list of whole numbers within limits, or of texts; ValueError if it is none."""
    if isinstance(value, str) or not isinstance(value, Iterable):
        raise ValueError(f'{name}: {value!r} is not a list')
    values = list(value)
    if not limits:
        for one in values:
            if not isinstance(one, str) or not one:
                raise ValueError(f'{name}: {one!r} is not a text')
        return values
    least, most = limits
    if len(values) > most - least + 1:
        raise ValueError(f'{name}: {len(values)} numbers; {most - least + 1} are the most')
    for one in values:
        if isinstance(one, bool) or not isinstance(one, int):
            raise ValueError(f'{name}: {one!r} is not a whole number')
        if not least <= one <= most:
            raise ValueError(f'{name}: {one} is not within {least} to {most}')
    return values
