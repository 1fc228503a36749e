# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the real executables: what a running node is told, and what it refuses."""

import math
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from harness import Sensor
from rcl_interfaces.msg import ParameterDescriptor, ParameterValue, SetParametersResult
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter
from retrolidar_ros.msg import Frame as FrameMsg
from test_node_features import (
    FRAME_ID,
    MARKER_FILE,
    NAMES,
    PATIENCE_S,
    Diagnostics,
    collect_diagnostics,
    node_command,
    subscribed,
    values_of,
)
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.demo import executable
from retrolidar_ros.detector import METHODS
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.processes import ProcessGroup
from retrolidar_ros.resources import shared_file
from retrolidar_ros.scene import Simulation
from retrolidar_ros.yaml_files import load_parameter_defaults, load_scene

DRIVER, DETECTOR, BARE = '/real/driver', '/live/detector', '/bare/detector'
COFFEE, HEARTBEAT = '/live/coffee', '/live/heartbeat'
FEED_PERIOD_S = 0.005
READ_ONLY = {
    DRIVER: {'serial_port', 'serial_baud', 'frame_id'},
    DETECTOR: {'marker_file', 'child_frame'},
    COFFEE: {'objects', 'target_frame'},
    HEARTBEAT: {'markers', 'window'},
}
NODES = pytest.mark.parametrize('node', READ_ONLY)
Changes = dict[str, Any]
"""Values by name; a parameter of rclpy where the type is to be another than the value's."""


def defaults_of(node: str) -> dict[str, Any]:
    kind = node.rpartition('/')[2]
    return load_parameter_defaults(shared_file('config/retrolidar.yaml'), kind)


class Live:
    """Running nodes that are fed with simulated frames, faster than they would come."""

    def __init__(self, listener: Listener, diagnostics: Diagnostics) -> None:
        self.listener = listener
        self.diagnostics = diagnostics

    def wait(self, done: Callable[[], bool], what: str) -> None:
        assert self.listener.spin_until(done, PATIENCE_S), f'waited in vain for {what}'

    def call(self, node: str, kind: Any, name: str, request: Any) -> Any:
        client = self.listener.node.create_client(kind, f'{node}/{name}')
        self.wait(client.service_is_ready, f'{node}/{name}')
        future: Any = client.call_async(request)
        self.wait(future.done, f'an answer of {node}/{name}')
        self.listener.node.destroy_client(client)
        return future.result()

    def names(self, node: str) -> set[str]:
        result = self.call(node, ListParameters, 'list_parameters', ListParameters.Request()).result
        # What every node has.
        return {
            name
            for name in result.names
            if name not in ('use_sim_time', 'start_type_description_service')
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

    def try_to_set(self, node: str, **changes: Any) -> SetParametersResult:
        """Set parameters all at once, or none of them."""
        messages = [
            (value if isinstance(value, Parameter) else Parameter(name, value=value))
            for name, value in changes.items()
        ]
        request = SetParametersAtomically.Request(
            parameters=[message.to_parameter_msg() for message in messages]
        )
        kind = SetParametersAtomically
        return self.call(node, kind, 'set_parameters_atomically', request).result

    def set(self, node: str, **changes: Any) -> None:
        """Set parameters, and forget what was read before."""
        result = self.try_to_set(node, **changes)
        assert result.successful, result.reason
        self.pass_time(0.3)
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
    frames = iter(Simulation(load_scene('coffee')).run(300.0))
    publisher = listener.node.create_publisher(FrameMsg, 'frames', 10)
    bare = [*node_command('detector', '/bare', publish_tf='false'), '-r', 'frames:=/live/frames']
    with ProcessGroup(directory) as processes:
        processes.start('driver', node_command('driver', '/real', serial_port=port))
        processes.start('detector', node_command('detector', '/live', marker_file=known))
        processes.start('bare', bare)
        processes.start('coffee', node_command('coffee', '/live'))
        processes.start('heartbeat', node_command('heartbeat', '/live'))
        live.wait(lambda: publisher.get_subscription_count() > 2, 'detectors')
        listener.node.create_timer(
            FEED_PERIOD_S, lambda: publisher.publish(to_frame_msg(next(frames), FRAME_ID))
        )
        yield live
        processes.check()
    listener.close()


@pytest.fixture
def live(nodes: Live) -> Iterator[Live]:
    """Give the detector its parameters back after the test."""
    yield nodes
    changeable = defaults_of(DETECTOR).keys() - READ_ONLY[DETECTOR] - {'registered_ids'}
    before = {name: defaults_of(DETECTOR)[name] for name in changeable}
    empty = Parameter('registered_ids', Parameter.Type.INTEGER_ARRAY, [])
    nodes.set(DETECTOR, **before, registered_ids=empty)


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
        message = Parameter.from_parameter_msg(_message(name, value))
        result = nodes.try_to_set(node, **{name: message})
        if name in READ_ONLY[node]:
            assert not result.successful, name
            assert result.reason == f'Trying to set a read-only parameter: {name}.'
        else:
            assert result.successful, result.reason
    assert nodes.get(node) == before


@pytest.mark.parametrize(
    ('node', 'arguments', 'message'),
    [
        ('driver', ['--params-file', '{}/nowhere.yaml'], 'nowhere.yaml'),
        ('detector', ['--params-file', '{}/broken.yaml'], 'broken.yaml'),
        ('detector', ['-p', 'method:=magic'], "method: 'magic' is not one of joint, soft"),
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


