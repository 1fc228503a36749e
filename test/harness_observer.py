# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Running nodes: how tests start, feed and end them, what these receive of them and ask them."""

import itertools
import os
import signal
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import PATIENCE_S, wait_for_readings
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import ParameterDescriptor, ParameterValue, SetParametersResult
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_srvs.srv import Trigger

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_frame_msg
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.reader import create_nodes
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import load_scene

# A shell lets its background jobs ignore SIGINT, and so do all that these start; but launches are
# ended by it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
RELIABLE = QoSProfile(depth=1000)
_ASK_AGAIN_S = 5.0
FRAME_ID = 'retrolidar_optical_frame'
COFFEE_IDS = {2073, 2096, 2107}


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def processes() -> Iterator[tuple[int, str]]:
    """Yield all processes there are, by their numbers and command lines."""
    for file in Path('/proc').glob('[0-9]*/cmdline'):
        with suppress(OSError):
            yield int(file.parent.name), file.read_text()


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
        """Return the answer of a service, which is asked once."""
        client = self._client(kind, service)
        self._wait_to_be_known(service.rpartition('/')[0])
        future = client.call_async(request)
        self._observer.wait(future.done, f'an answer of {service}')
        return future.result()

    def _wait_to_be_known(self, node: str) -> None:
        """Wait until a node has discovered all clients, as before, their answers are lost.

        It does so in the order in which they were made, so an answer to a new one shows it.
        """
        client = self._observer.node.create_client(ListParameters, f'{node}/list_parameters')
        self._observer.wait(client.service_is_ready, node)
        self._ask(client, ListParameters.Request(), node)
        self._observer.node.destroy_client(client)

    def read(self, kind: Any, service: str, request: Any) -> Any:
        """Return the answer of a service that changes nothing."""
        return self._ask(self._client(kind, service), request, service)

    def _ask(self, client: Any, request: Any, name: str) -> Any:
        """Return the answer to a client, which asks again if none comes."""
        for _ in range(round(PATIENCE_S / _ASK_AGAIN_S)):
            future = client.call_async(request)
            if self._observer.spin_until(future.done, _ASK_AGAIN_S):
                return future.result()
        raise AssertionError(f'waited in vain for an answer of {name}')

    def trigger(self, service: str) -> tuple[bool, str]:
        """Return whether a service did what it is for, and what it says."""
        answer = self.call(Trigger, service, Trigger.Request())
        return answer.success, answer.message

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


class System(Observer):
    """Nodes of a namespace, their messages and logs."""

    def __init__(self, directory: Path, namespace: str, processes: ProcessGroup) -> None:
        super().__init__(namespace)
        self.port = directory / 'port'
        self.processes = processes
        self.started: list[str] = []

    def start(
        self, node: str, *arguments: str, name: str = '', namespace: str = '', **parameters: object
    ) -> None:
        """Start a node; its process has a name of its own if there are several of a kind."""
        command = [executable(node), '--ros-args', '-r', f'__ns:={namespace or self.namespace}']
        command += arguments
        for key, value in parameters.items():
            command += ['-p', f'{key}:={value}']
        self.processes.start(name or node, command)
        self.started.append(name or node)

    def stop(self, name: str, number: signal.Signals = signal.SIGINT) -> None:
        """End a process by a signal, each of which but SIGKILL must end it in order."""
        if number != signal.SIGINT:
            os.kill(self.processes.pid(name), number)
            os.waitid(os.P_PID, self.processes.pid(name), os.WEXITED | os.WNOWAIT)
        self.started.remove(name)
        assert self.processes.stop(name) == (-number if number == signal.SIGKILL else 0)
        assert 'Traceback' not in self.log(name)

    def log(self, name: str) -> str:
        return self.processes.log(name).read_text()

    @contextmanager
    def fed(self, topic: str) -> Iterator[list[int]]:
        """Publish frames of the coffee scene, faster than they would come; yield their stamps."""
        simulation = Simulation(load_scene('coffee'))
        frames = itertools.chain.from_iterable(map(simulation.advance, itertools.repeat(100)))
        publisher = self.node.create_publisher(FrameMsg, topic, 10)
        self.wait(lambda: publisher.get_subscription_count() > 0, f'subscribers of {topic}')
        sent_ns: list[int] = []

        def send() -> None:
            frame = next(frames)
            sent_ns.append(frame.stamp_ns)
            publisher.publish(to_frame_msg(frame, FRAME_ID))

        feed = self.node.create_timer(0.007, send)
        try:
            yield sent_ns
        finally:
            self.node.destroy_timer(feed)
            self.node.destroy_publisher(publisher)

    def read_all(self, ids: set[int] = COFFEE_IDS) -> None:
        """Wait until each marker is read from now on."""
        self.markers.clear()
        wait_for_readings(self, ids)


@contextmanager
def running(directory: Path, namespace: str) -> Iterator[System]:
    """Open a system; what runs at the end of the block must end in order."""
    with ProcessGroup(directory) as processes:
        system = System(directory, namespace, processes)
        try:
            yield system
            processes.check()
            for name in list(system.started):
                system.stop(name)
        finally:
            system.close()


@contextmanager
def in_this_process(system: System, *arguments: str) -> Iterator[SingleThreadedExecutor]:
    """Make driver and detector in this process; a test can spin them and replace functions."""
    rclpy.init(args=['--ros-args', '-r', f'__ns:={system.namespace}', *arguments])
    executor = SingleThreadedExecutor()
    nodes = create_nodes()
    for node in nodes:
        executor.add_node(node)
    try:
        yield executor
    finally:
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
