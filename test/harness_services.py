# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Services of running nodes, above all those of their parameters."""

from typing import Any

from harness import PATIENCE_S
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterDescriptor, ParameterValue, SetParametersResult
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter

from retrolidar_ros.nodes.listener import Listener


def parameter_messages(changes: dict[str, Any]) -> list[ParameterMsg]:
    """Return parameters of values, be they plain or of a type of one's choice."""

    def value_of(name: str, value: Any) -> ParameterValue:
        if isinstance(value, ParameterValue):
            return value
        parameter: Any = Parameter
        return parameter(name, value=value).get_parameter_value()

    return [ParameterMsg(name=name, value=value_of(name, one)) for name, one in changes.items()]


class Services:
    """Clients, one for each service."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._clients: dict[str, Any] = {}

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of a service."""
        listener = self._listener
        if service not in self._clients:
            client = self._clients[service] = listener.node.create_client(kind, service)
            assert listener.spin_until(client.service_is_ready, PATIENCE_S), f'no {service}'
        future = self._clients[service].call_async(request)
        assert listener.spin_until(future.done, PATIENCE_S), f'no answer of {service}'
        return future.result()

    def names(self, node: str) -> set[str]:
        """Return the names of a node's parameters, but for those that every node has."""
        request = ListParameters.Request()
        result = self.call(ListParameters, f'{node}/list_parameters', request).result
        return {
            name
            for name in result.names
            if name not in ('use_sim_time', 'start_type_description_service')
            and not name.startswith('qos_overrides.')
        }

    def describe(self, node: str) -> list[ParameterDescriptor]:
        request = DescribeParameters.Request(names=sorted(self.names(node)))
        return list(
            self.call(DescribeParameters, f'{node}/describe_parameters', request).descriptors
        )

    def get(self, node: str) -> dict[str, ParameterValue]:
        names = sorted(self.names(node))
        request = GetParameters.Request(names=names)
        values = self.call(GetParameters, f'{node}/get_parameters', request).values
        return dict(zip(names, values, strict=True))

    def try_to_set(self, node: str, **changes: Any) -> list[SetParametersResult]:
        """Set parameters one after the other."""
        request = SetParameters.Request(parameters=parameter_messages(changes))
        return list(self.call(SetParameters, f'{node}/set_parameters', request).results)

    def set(self, node: str, **changes: Any) -> None:
        for result in self.try_to_set(node, **changes):
            assert result.successful, result.reason
