# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the real executables: what a running node is told, and what it refuses."""

import math
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from harness import Sensor
from rcl_interfaces.msg import Parameter as ParameterMsg
from rcl_interfaces.msg import (
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from test_node_features import (
    FRAME_ID,
    MARKER_FILE,
    NAMES,
    PATIENCE_S,
    Diagnostics,
    collect_diagnostics,
    endless,
    node_command,
    subscribed,
    values_of,
)
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.detector import METHODS
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_parameter_defaults

DRIVER, DETECTOR, BARE = '/real/driver', '/live/detector', '/bare/detector'
COFFEE, HEARTBEAT = '/live/coffee', '/live/heartbeat'
FEED_PERIOD_S = 0.007
SETTLING_S = 0.2  # until what was on its way has come
READ_ONLY = {
    DRIVER: {'serial_port', 'serial_baud', 'protocol', 'frame_id', 'autostart'},
    DETECTOR: {'marker_file', 'child_frame'},
    COFFEE: {'objects', 'target_frame'},
    HEARTBEAT: {'markers', 'window'},
}
NODES = pytest.mark.parametrize('node', READ_ONLY)


def defaults_of(node: str) -> dict[str, Any]:
    kind = node.rpartition('/')[2]
    return load_parameter_defaults(shared_file('config/retrolidar.yaml'), kind)


def messages_of(changes: dict[str, Any]) -> list[ParameterMsg]:
    """Return parameters of values, be they plain or of a type of one's choice."""

    def value_of(name: str, value: Any) -> ParameterValue:
        if isinstance(value, ParameterValue):
            return value
        parameter: Any = Parameter
        return parameter(name, value=value).get_parameter_value()

    return [ParameterMsg(name=name, value=value_of(name, one)) for name, one in changes.items()]


def empty_list(kind: int) -> ParameterValue:
    return ParameterValue(type=kind)


class Live:
    """Running nodes, and what they are asked and told."""

    def __init__(self, listener: Listener, diagnostics: Diagnostics) -> None:
        self.listener = listener
        self.diagnostics = diagnostics
        self._clients: dict[str, Any] = {}

    def wait(self, done: Callable[[], bool], what: str) -> None:
        assert self.listener.spin_until(done, PATIENCE_S), f'waited in vain for {what}'

    @contextmanager
    def fed(self, namespace: str) -> Iterator[None]:
        """Publish frames for a detector, faster than they would come."""
        frames = endless(load_scene('coffee'))
        node = self.listener.node
        publisher = node.create_publisher(FrameMsg, f'{namespace}/frames', 10)
        feed = node.create_timer(
            FEED_PERIOD_S, lambda: publisher.publish(to_frame_msg(next(frames), FRAME_ID))
        )
        try:
            yield
        finally:
            node.destroy_timer(feed)
            node.destroy_publisher(publisher)

    def call(self, node: str, kind: Any, name: str, request: Any) -> Any:
        service = f'{node}/{name}'
        if service not in self._clients:
            self._clients[service] = self.listener.node.create_client(kind, service)
            self.wait(self._clients[service].service_is_ready, service)
        future = self._clients[service].call_async(request)
        self.wait(future.done, f'an answer of {service}')
        return future.result()

    def names(self, node: str) -> set[str]:
        result = self.call(node, ListParameters, 'list_parameters', ListParameters.Request()).result
        # What every node has.
        return {
            name
            for name in result.names
            if name not in ('use_sim_time', 'start_type_description_service')
            and not name.startswith('qos_overrides.')
        }

    def describe(self, node: str) -> list[ParameterDescriptor]:
        request = DescribeParameters.Request(names=sorted(defaults_of(node)))
        answer = self.call(node, DescribeParameters, 'describe_parameters', request)
        return list(answer.descriptors)

    def get(self, node: str) -> dict[str, ParameterValue]:
        names = sorted(defaults_of(node))
        request = GetParameters.Request(names=names)
        answer = self.call(node, GetParameters, 'get_parameters', request)
        return dict(zip(names, answer.values, strict=True))

    def try_to_set(self, node: str, **changes: Any) -> list[SetParametersResult]:
        """Set parameters one after the other."""
        request = SetParameters.Request(parameters=messages_of(changes))
        return list(self.call(node, SetParameters, 'set_parameters', request).results)

    def set(self, node: str, **changes: Any) -> None:
        """Set parameters, and forget what was read before."""
        for result in self.try_to_set(node, **changes):
            assert result.successful, result.reason
        self.pass_time(SETTLING_S)
        self.forget()

    def forget(self) -> None:
        self.listener.markers.clear()
        self.listener.transforms.clear()

    def pass_time(self, duration_s: float) -> None:
        self.listener.spin_until(lambda: False, duration_s)

    def read(self) -> list[int]:
        return [message.id for message, _ in self.listener.markers]

    def wait_for_readings(self, count: int, *ids: int) -> None:
        """Wait until each of these IDs was read so often."""
        self.wait(lambda: all(self.read().count(one) >= count for one in ids), f'{ids}')


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('live') / 'port'


@pytest.fixture(scope='module')
def nodes(port: Path) -> Iterator[Live]:
    directory = port.parent
    known = directory / 'markers.yaml'
    known.write_text(MARKER_FILE)
    listener = Listener('/live')
    live = Live(listener, collect_diagnostics(listener))
    with ProcessGroup(directory) as processes:
        processes.start('driver', node_command('driver', '/real', serial_port=port))
        processes.start('detector', node_command('detector', '/live', marker_file=known))
        processes.start('bare', node_command('detector', '/bare', publish_tf='false'))
        processes.start('coffee', node_command('coffee', '/live'))
        processes.start('heartbeat', node_command('heartbeat', '/live'))
        with live.fed('/live'):
            yield live
        processes.check()
    listener.close()


@pytest.fixture
def live(nodes: Live) -> Iterator[Live]:
    """Give the detector its parameters back after the test."""
    yield nodes
    changeable = defaults_of(DETECTOR).keys() - READ_ONLY[DETECTOR] - {'registered_ids'}
    before = {name: defaults_of(DETECTOR)[name] for name in changeable}
    none = empty_list(ParameterType.PARAMETER_INTEGER_ARRAY)
    nodes.set(DETECTOR, **before, registered_ids=none)


@NODES
def test_every_parameter_is_described_and_limited(nodes: Live, node: str) -> None:
    defaults = defaults_of(node)
    assert nodes.names(node) == set(defaults)
    for descriptor in nodes.describe(node):
        name, default = descriptor.name, defaults[descriptor.name]
        assert descriptor.description.endswith(('.', ']', 'z forward')), name
        assert descriptor.read_only == (name in READ_ONLY[node]), name
        limits = [*descriptor.integer_range, *descriptor.floating_point_range]
        if isinstance(default, (int, float)) and not isinstance(default, bool):
            (limit,) = limits
            assert limit.from_value <= default <= limit.to_value, name
            assert limit.from_value < limit.to_value, name
        else:
            assert not limits, name
        if isinstance(default, list):
            assert 'or []' in descriptor.additional_constraints, name
        if name == 'method':
            assert descriptor.additional_constraints == f'one of {", ".join(METHODS)}'


@NODES
def test_what_is_read_only_refuses_and_the_rest_does_not(nodes: Live, node: str) -> None:
    before = nodes.get(node)
    for name, value in before.items():
        (result,) = nodes.try_to_set(node, **{name: value})
        if name in READ_ONLY[node]:
            assert not result.successful, name
            assert result.reason == f'Trying to set a read-only parameter: {name}.'
        else:
            assert result.successful, result.reason
    assert nodes.get(node) == before


@pytest.mark.parametrize('method', METHODS)
def test_another_method_goes_on_reading(live: Live, method: str) -> None:
    live.set(DETECTOR, method=method)
    live.wait_for_readings(1, *NAMES)
    told = live.diagnostics[f'{DETECTOR}: markers']
    live.wait(lambda: bool(told) and values_of(told[-1])['method'] == method, 'what it says')


@pytest.mark.parametrize('method', ['joint', 'paper'])
@pytest.mark.parametrize(
    'allowed', [{'only_registered': True}, {'registered_ids': [2073, 2096]}], ids=str
)
def test_what_is_not_allowed_never_comes(live: Live, method: str, allowed: dict[str, Any]) -> None:
    live.set(DETECTOR, method=method, **allowed)
    live.wait_for_readings(3, 2073, 2096)
    assert set(live.read()) == {2073, 2096}


def test_the_file_and_the_list_add_up(live: Live) -> None:
    live.set(DETECTOR, only_registered=True, registered_ids=[2107])
    live.wait_for_readings(1, *NAMES)
    live.set(DETECTOR, only_registered=False)
    live.wait_for_readings(3, 2107)
    assert set(live.read()) == {2107}


@pytest.mark.parametrize(
    'kind',
    [
        ParameterType.PARAMETER_BOOL_ARRAY,
        ParameterType.PARAMETER_STRING_ARRAY,
    ],
)
def test_an_empty_list_of_any_type_lets_all_come_again(live: Live, kind: int) -> None:
    live.set(DETECTOR, registered_ids=[2107])
    live.wait_for_readings(2, 2107)
    assert set(live.read()) == {2107}
    live.set(DETECTOR, registered_ids=empty_list(kind))
    live.wait_for_readings(1, *NAMES)


def test_tf_may_be_left_alone_for_a_while(live: Live) -> None:
    live.set(DETECTOR, publish_tf=False)
    live.wait_for_readings(2, *NAMES)
    assert live.listener.transforms == []
    live.set(DETECTOR, publish_tf=True)
    live.wait(
        lambda: {one.child_frame_id for one in live.listener.transforms} >= set(NAMES.values()),
        'transforms',
    )


def test_tf_may_be_joined_later(live: Live) -> None:
    live.set(BARE, publish_tf=True)
    with live.fed('/bare'):
        live.wait(
            lambda: 'marker_2073' in {one.child_frame_id for one in live.listener.transforms},
            'transforms',
        )
    live.set(BARE, publish_tf=False)


def test_shapes_last_as_long_as_is_said(live: Live) -> None:
    live.set(DETECTOR, stale_after=7.25)
    with subscribed(live.listener, MarkerArray, '/live/marker_array') as arrays:
        live.wait(lambda: bool(arrays), 'shapes')
    for shape in arrays[0].markers:
        assert (shape.lifetime.sec, shape.lifetime.nanosec) == (7, 250_000_000)


REFUSED: list[tuple[dict[str, Any], str]] = [
    ({'method': 'magic'}, "method: 'magic' is not one of joint, paper"),
    ({'max_packets': 9}, 'max_packets out of range'),
    ({'max_packets': 0}, 'max_packets out of range'),
    ({'max_packets': 2.0}, 'Wrong parameter type'),
    ({'bit_period': -1.0}, 'bit_period out of range'),
    ({'noise_floor': math.nan}, 'noise_floor out of range'),
    ({'stale_after': math.inf}, 'stale_after out of range'),
    ({'publish_tf': 'no'}, 'Wrong parameter type'),
    ({'registered_ids': [7, 5000]}, 'registered_ids: 5000 is not within 0 to 4095'),
    ({'registered_ids': [0]}, 'registered_ids holds no usable ID'),
    ({'registered_ids': 7}, 'registered_ids: 7 is not a list'),
    ({'registered_ids': 'mug'}, "registered_ids: 'mug' is not a list"),
    ({'registered_ids': [True]}, 'registered_ids: True is not a whole number'),
    ({'registered_ids': ParameterValue()}, 'registered_ids: None is not a list'),
    ({'method': ParameterValue()}, 'cannot be undeclared'),
]


@pytest.mark.parametrize(('changes', 'reason'), REFUSED, ids=str)
def test_what_is_refused_changes_nothing(nodes: Live, changes: dict[str, Any], reason: str) -> None:
    before = nodes.get(DETECTOR)
    (result,) = nodes.try_to_set(DETECTOR, **changes)
    assert not result.successful
    assert reason in result.reason
    assert '\n' not in result.reason
    assert nodes.get(DETECTOR) == before


def test_one_refusal_spoils_all_that_is_to_be_set_at_once(live: Live) -> None:
    before = live.get(DETECTOR)
    request = SetParametersAtomically.Request(
        parameters=messages_of({'publish_tf': False, 'method': 'paper', 'registered_ids': [0]})
    )
    kind = SetParametersAtomically
    answer = live.call(DETECTOR, kind, 'set_parameters_atomically', request)
    assert not answer.result.successful
    assert 'no usable ID' in answer.result.reason
    assert live.get(DETECTOR) == before
    for _ in range(2):
        live.pass_time(SETTLING_S)
        live.forget()
        live.wait_for_readings(1, *NAMES)
        live.wait(lambda: bool(live.listener.transforms), 'transforms')
        live.set(DETECTOR, stale_after=5.0)  # does not bring them after all


def test_an_allow_list_without_a_file_is_refused_and_detection_goes_on(live: Live) -> None:
    (result,) = live.try_to_set(BARE, only_registered=True)
    assert not result.successful
    assert result.reason == 'only_registered: there is no marker_file with markers'
    with (
        subscribed(live.listener, MarkerDetection, '/bare/markers') as readings,
        live.fed('/bare'),
    ):
        live.wait(lambda: {one.id for one in readings} >= set(NAMES), 'all markers')


def test_the_ends_of_all_ranges_can_be_borne(live: Live) -> None:
    """Bits of 2 ms or 10 s read nothing, but they do not end the node."""
    for descriptor in live.describe(DETECTOR):
        name = descriptor.name
        limits = [*descriptor.integer_range, *descriptor.floating_point_range]
        for value in [end for limit in limits for end in (limit.from_value, limit.to_value)]:
            (result,) = live.try_to_set(DETECTOR, **{name: value})
            assert result.successful, result.reason
            live.pass_time(0.1)
        if limits:
            live.try_to_set(DETECTOR, **{name: defaults_of(DETECTOR)[name]})
    live.forget()
    live.wait_for_readings(1, *NAMES)


def test_a_transport_delay_is_taken_off_from_now_on(nodes: Live, port: Path) -> None:
    def error_s() -> float:
        """Return the median error of the stamps of the next frames."""
        with subscribed(nodes.listener, FrameMsg, '/real/frames') as frames:
            nodes.wait(lambda: len(frames) >= 25, 'frames')
        errors_ns = [
            to_ns(one.header.stamp) - sensor.middle_ns[one.sequence] for one in frames[:20]
        ]
        return float(np.median(errors_ns)) * 1e-9

    with Sensor(load_scene('coffee'), port) as sensor:
        nodes.wait(lambda: bool(sensor.middle_ns), 'the driver to listen')
        nodes.pass_time(0.5)
        before_s = error_s()
        assert abs(before_s) < 0.02
        nodes.set(DRIVER, transport_delay=0.0505)
        assert error_s() - before_s == pytest.approx(-0.04, abs=0.01)
        (result,) = nodes.try_to_set(DRIVER, transport_delay=-0.1)
        assert not result.successful
        assert 'transport_delay out of range' in result.reason
        nodes.set(DRIVER, transport_delay=0.0105)
        assert error_s() == pytest.approx(before_s, abs=0.01)


@pytest.mark.parametrize(
    ('node', 'arguments', 'message'),
    [
        ('driver', ['--params-file', '{}/nowhere.yaml'], 'nowhere.yaml'),
        ('detector', ['--params-file', '{}/broken.yaml'], 'broken.yaml'),
        ('detector', ['-p', 'method:=magic'], "method: 'magic' is not one of joint, paper"),
        ('detector', ['-p', 'marker_file:={}/nowhere.yaml'], 'marker_file: [Errno 2] No such file'),
        ('detector', ['-p', 'marker_file:={}/twice.yaml'], 'key 2073 stands here a second time'),
        ('detector', ['-p', 'marker_file:={}/same.yaml'], 'marker 2073 has the frame mug, too'),
        ('detector', ['-p', 'only_registered:=true'], 'only_registered: there is no marker_file'),
        ('detector', ['-p', 'child_frame:=left'], "child_frame: 'left' needs {{name}} once"),
        ('coffee', ['-p', 'objects:=[]'], 'objects: there is no name'),
        ('heartbeat', ['-p', 'markers:=[]'], 'markers: there is no name'),
    ],
)
def test_what_cannot_be_is_one_clear_message(
    node: str, arguments: list[str], message: str, tmp_path: Path
) -> None:
    (tmp_path / 'broken.yaml').write_text('/**:\n  ros__parameters:\n    method: [joint')
    (tmp_path / 'twice.yaml').write_text('markers:\n  2073: {frame: a}\n  2073: {frame: b}\n')
    (tmp_path / 'same.yaml').write_text('markers: {2073: {frame: mug}, 2096: {frame: mug}}\n')
    result = subprocess.run(
        [executable(node), '--ros-args', *(part.format(tmp_path) for part in arguments)],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    output = result.stderr + result.stdout
    assert result.returncode == 2, output
    assert output.count(message.format()) == 1, output
    assert 'Traceback' not in output
    said = [line for line in output.splitlines() if '[rcl]: Failed to parse' not in line]
    assert len(said) - ('twice.yaml' in output) == 1, output
