# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters whose defaults live in one place, `config/retrolidar.yaml`."""

from __future__ import annotations

from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from retrolidar_ros.resources import shared_file
from retrolidar_ros.yaml_files import load_parameter_defaults


class Parameters:
    """Declares the parameters of a node, each with the default of the shipped file."""

    def __init__(self, node: Node, kind: str) -> None:
        """Read the defaults of the nodes of one `kind`, such as driver."""
        self._node = node
        self._defaults = load_parameter_defaults(shared_file('config/retrolidar.yaml'), kind)

    def text(self, name: str, description: str, among: tuple[str, ...] = ()) -> str:
        """Declare a read-only string and return its value; ValueError if it is not `among`."""
        constraints = f'one of {", ".join(among)}' if among else ''
        value = str(self._declare(name, description, additional_constraints=constraints))
        if among and value not in among:
            raise ValueError(f'{name}: {value!r} is not {constraints}')
        return value

    def flag(self, name: str, description: str) -> bool:
        """Declare a read-only boolean and return its value."""
        return bool(self._declare(name, description))

    def integer(self, name: str, description: str, minimum: int, maximum: int) -> int:
        """Declare a read-only integer within limits and return its value."""
        limits = IntegerRange(from_value=minimum, to_value=maximum, step=0)
        return int(self._declare(name, description, integer_range=[limits]))

    def integers(self, name: str, description: str, minimum: int, maximum: int) -> list[int]:
        """Declare a read-only list of integers and return its value, which may be empty.

        Raises
        ------
        ValueError
            If one is not within the limits, which ROS knows for single numbers only.
        """
        kind = Parameter.Type.INTEGER_ARRAY
        descriptor = {
            'description': description,
            'type': kind.value,
            'additional_constraints': f'each {minimum} to {maximum}',
        }
        # An empty list is taken for bytes as a default, and comes without a value from a file. So
        # the type is declared, and the empty list set afterwards: a parameter without a value
        # would keep the tools from reading the others, too.
        parameter = self._node.declare_parameter(
            name, self._defaults[name] or kind, ParameterDescriptor(**descriptor)
        )
        if parameter.value is None:
            self._node.set_parameters([Parameter(name, kind, [])])
        self._node.set_descriptor(name, ParameterDescriptor(**descriptor, read_only=True))
        numbers = [int(number) for number in self._node.get_parameter(name).value]
        for number in numbers:
            if not minimum <= number <= maximum:
                raise ValueError(f'{name}: {number} is not within {minimum} to {maximum}')
        return numbers

    def number(self, name: str, description: str, minimum: float, maximum: float) -> float:
        """Declare a read-only float within limits and return its value."""
        limits = FloatingPointRange(from_value=minimum, to_value=maximum, step=0.0)
        return float(self._declare(name, description, floating_point_range=[limits]))

    def warn_of_unknown(self) -> None:
        """Log a warning for each parameter that was set but that no node of the kind has."""
        for name in self._node._parameter_overrides:
            if not self._node.has_parameter(name) and not name.startswith('qos_overrides.'):
                near = get_close_matches(name, self._defaults, n=1)
                hint = f'did you mean {near[0]}?' if near else f'known: {", ".join(self._defaults)}'
                self._node.get_logger().warning(f'parameter {name} is unknown; {hint}')

    def _declare(self, name: str, description: str, **constraints: Any) -> Any:
        descriptor = ParameterDescriptor(description=description, read_only=True, **constraints)
        return self._node.declare_parameter(name, self._defaults[name], descriptor).value
