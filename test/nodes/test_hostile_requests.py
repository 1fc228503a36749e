# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Requests and parameter files that no tool sends, and qualities of service that somebody sets."""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.listener import Listener

PATIENCE_S = 60.0


@pytest.mark.parametrize('node', ['driver', 'detector'])
def test_impossible_values_are_refused(tmp_path: Path, node: str) -> None:
    """A type that is none would end the node by itself."""
    listener = Listener('/hostile')

    def answer(kind: Any, service: str, name: str, value: ParameterValue) -> Any:
        client = listener.node.create_client(kind, f'{node}/{service}')
        assert listener.spin_until(client.service_is_ready, PATIENCE_S)
        good = Parameter(name='use_sim_time', value=ParameterValue(type=1, bool_value=False))
        request = kind.Request(parameters=[good, Parameter(name=name, value=value)])
        future = client.call_async(request)
        assert listener.spin_until(future.done, PATIENCE_S)
        response: Any = future.result()  # type: ignore[no-untyped-call]
        return response

    with ProcessGroup(tmp_path) as processes:
        processes.start(node, [executable(node), '--ros-args', '-r', '__ns:=/hostile'])
        odd = ParameterValue(type=200)
        first = answer(SetParameters, 'set_parameters', 'anything', odd).results
        atomically = 'set_parameters_atomically'
        second = answer(SetParametersAtomically, atomically, 'anything', odd).result
        if node == 'detector':
            many = ParameterValue(type=7, integer_array_value=[1] * 200_000)
            third = answer(SetParametersAtomically, atomically, 'registered_ids', many).result
            assert third.reason == 'registered_ids: 200000 numbers; 4096 are the most'
        processes.check()
    listener.close()
    assert len(first) == 2
    assert not any(result.successful for result in [*first, second])
    assert first[0].reason == second.reason == 'anything: there is no type 200'


def test_landmarks_take_qualities_of_service(tmp_path: Path) -> None:
    listener = Listener('/quality')
    overrides = {
        '/quality/markers.subscription': 'best_effort',
        '/quality/landmarks/marker_array.publisher': 'best_effort',
    }
    command = [executable('landmarks'), '--ros-args', '-r', '__ns:=/quality']
    for topic, reliability in overrides.items():
        command += ['-p', f'qos_overrides.{topic}.reliability:={reliability}']

    def found() -> set[str]:
        infos = [
            *listener.node.get_subscriptions_info_by_topic('/quality/markers'),
            *listener.node.get_publishers_info_by_topic('/quality/landmarks/marker_array'),
        ]
        return {
            f'{one.endpoint_type.name} {one.qos_profile.reliability.name}'
            for one in infos
            if one.node_name == 'landmarks'
        }

    with ProcessGroup(tmp_path) as processes:
        processes.start('landmarks', command)
        assert listener.spin_until(lambda: len(found()) == 2, PATIENCE_S)
        assert found() == {'SUBSCRIPTION BEST_EFFORT', 'PUBLISHER BEST_EFFORT'}
        assert 'is unknown' not in processes.log('landmarks').read_text()
    listener.close()
