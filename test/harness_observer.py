# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What tests receive from running nodes, wait for, and ask of their services."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import PATIENCE_S
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterDescriptor, ParameterValue, SetParametersResult
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from retrolidar_ros.nodes.listener import Listener

LATCHED = QoSProfile(  # type: ignore[no-untyped-call]
    depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
RELIABLE = QoSProfile(depth=1000)  # type: ignore[no-untyped-call]
_ASK_AGAIN_S = 5.0


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


class Observer(Listener):
    """A listener that also collects other topics and the statuses of all nodes."""

    def __init__(self, namespace: str) -> None:
        super().__init__(namespace)
        self.namespace = namespace
        self.services = Services(self)
        self.statuses: defaultdict[str, list[DiagnosticStatus]] = defaultdict(list)
        """By `node: subject`, which begins with the namespace if that is another one."""
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._take_statuses, 100)

    def _take_statuses(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.statuses[status.name.removeprefix(f'{self.namespace}/')].append(status)

    def collect(self, kind: Any, topic: str, qos: Any = LATCHED) -> list[Any]:
        """Subscribe; what comes is in the list."""
        came: list[Any] = []
        self.node.create_subscription(kind, topic, came.append, qos)
        return came

    @contextmanager
    def subscribed(self, kind: Any, topic: str) -> Iterator[list[Any]]:
        """Subscribe for as long as the block lasts."""
        came: list[Any] = []
        subscription = self.node.create_subscription(kind, topic, came.append, 100)
        try:
            yield came
        finally:
            self.node.destroy_subscription(subscription)

    def wait(self, done: Callable[[], bool], what: str, timeout_s: float = PATIENCE_S) -> None:
        assert self.spin_until(done, timeout_s), f'waited in vain for {what}'

    def wait_for_transforms(self, *names: str) -> None:
        """Wait until TF has frames of these names."""
        self.wait(lambda: {t.child_frame_id for t in self.transforms} >= set(names), f'{names}')

    def wait_for_frames(self, count: int) -> None:
        """Wait until more frames than that have come."""
        self.wait(lambda: len(self.frames) > count, 'frames')

    def pass_time(self, duration_s: float) -> None:
        self.spin_until(lambda: False, duration_s)

    def next_status(self, name: str) -> DiagnosticStatus:
        seen = len(self.statuses[name])
        self.wait(lambda: len(self.statuses[name]) > seen, f'a status of {name}')
        return self.statuses[name][-1]

    def number(self, name: str, key: str) -> int:
        """Return a number of the next status."""
        return int(values_of(self.next_status(name))[key])

    def wait_for_status(
        self, name: str, level: bytes, text: str, timeout_s: float = PATIENCE_S
    ) -> DiagnosticStatus:
        """Return the next status of a level that has a text within."""
        seen = len(self.statuses[name])

        def found() -> list[DiagnosticStatus]:
            statuses = self.statuses[name][seen:]
            return [one for one in statuses if one.level == level and text in one.message]

        self.wait(lambda: bool(found()), f'{text!r} of {name}', timeout_s)
        return found()[0]


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

    def __init__(self, observer: Observer) -> None:
        self._observer = observer
        self._clients: dict[str, Any] = {}

    def _client(self, kind: Any, service: str) -> Any:
        if service not in self._clients:
            client = self._clients[service] = self._observer.node.create_client(kind, service)
            self._observer.wait(client.service_is_ready, service)
        return self._clients[service]

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of a service."""
        future = self._client(kind, service).call_async(request)
        self._observer.wait(future.done, f'an answer of {service}')
        return future.result()

    def read(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of a service that changes nothing, asked again if none comes.

        An answer is lost as long as the node has not discovered the reader of the client.
        """
        client = self._client(kind, service)
        for _ in range(round(PATIENCE_S / _ASK_AGAIN_S)):
            future = client.call_async(request)
            if self._observer.spin_until(future.done, _ASK_AGAIN_S):
                return future.result()
        raise AssertionError(f'waited in vain for an answer of {service}')

    def trigger(self, service: str) -> Trigger.Response:
        return self.call(Trigger, service, Trigger.Request())

    def change_state(self, node: str, transition: int) -> bool:
        """Return whether a node with a life cycle made a transition."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.call(ChangeState, f'{node}/change_state', request).success)

    def names(self, node: str) -> set[str]:
        """Return the names of a node's parameters, but for those that every node has."""
        request = ListParameters.Request()
        result = self.read(ListParameters, f'{node}/list_parameters', request).result
        return {
            name
            for name in result.names
            if name not in ('use_sim_time', 'start_type_description_service')
            and not name.startswith('qos_overrides.')
        }

    def describe(self, node: str) -> list[ParameterDescriptor]:
        request = DescribeParameters.Request(names=sorted(self.names(node)))
        return list(
            self.read(DescribeParameters, f'{node}/describe_parameters', request).descriptors
        )

    def get(self, node: str, *only: str) -> dict[str, ParameterValue]:
        names = sorted(only or self.names(node))
        request = GetParameters.Request(names=names)
        values = self.read(GetParameters, f'{node}/get_parameters', request).values
        return dict(zip(names, values, strict=True))

    def try_to_set(self, node: str, **changes: Any) -> list[SetParametersResult]:
        """Set parameters one after the other."""
        request = SetParameters.Request(parameters=parameter_messages(changes))
        return list(self.call(SetParameters, f'{node}/set_parameters', request).results)

    def set(self, node: str, **changes: Any) -> None:
        for result in self.try_to_set(node, **changes):
            assert result.successful, result.reason
