# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of running nodes: their descriptions, what setting them does, what is refused."""

import math
import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from harness import Sensor
from harness_observer import System, parameter_messages, running, values_of
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from test_topics import MARKER_FILE, NAMES
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.detector import METHODS
from retrolidar_ros.detector.detection import Reason
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.settings.parameter import Parameter, declared

DRIVER, DETECTOR, BARE = '/real/driver', '/live/detector', '/bare/detector'
COFFEE, HEARTBEAT = '/live/coffee', '/live/heartbeat'
EMPTY = ParameterValue(type=ParameterType.PARAMETER_INTEGER_ARRAY)


def declared_of(node: str) -> dict[str, Parameter]:
    return declared()[node.rpartition('/')[2]]


class Live:
    """Nodes that are fed, and whose parameters are set."""

    def __init__(self, system: System, sent_ns: list[int]) -> None:
        """Take the stamps of the frames that the detector is fed, to which more are added [ns]."""
        self.system = system
        self.services = system.services
        self._sent_ns = sent_ns
        self._since_ns = 0

    def set(self, node: str, **changes: Any) -> None:
        """Set parameters; from now on, what was read of earlier frames does not count."""
        self.services.set(node, **changes)
        self._since_ns = self._sent_ns[-1]

    def _readings(self) -> list[MarkerDetection]:
        return [one for one, _ in self.system.markers if to_ns(one.end) > self._since_ns]

    def read(self) -> list[int]:
        return [message.id for message in self._readings()]

    def transformed(self) -> list[str]:
        """Return the names of what was read and has a transform."""
        read = {(one.child_frame_id, to_ns(one.header.stamp)) for one in self._readings()}
        sent = {(one.child_frame_id, to_ns(one.header.stamp)) for one in self.system.transforms}
        return sorted({name for name, _ in read & sent})

    def wait_for_readings(self, count: int, *ids: int) -> None:
        """Wait until each of these IDs was read so often."""
        self.system.wait(lambda: all(self.read().count(one) >= count for one in ids), f'{ids}')


@pytest.fixture(scope='module')
def nodes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    directory = tmp_path_factory.mktemp('live')
    known = directory / 'markers.yaml'
    known.write_text(MARKER_FILE)
    with running(directory, '/live') as system:
        system.start('driver', namespace='/real', serial_port=system.port)
        system.start('detector', '--log-level', 'live.detector:=debug', marker_file=known)
        system.start('detector', name='bare', namespace='/bare', publish_tf='false')
        system.start('coffee')
        system.start('heartbeat')
        with system.fed('/live/frames') as sent_ns:
            yield Live(system, sent_ns)


@pytest.fixture
def live(nodes: Live) -> Iterator[Live]:
    """Give the detector its parameters back after the test."""
    yield nodes
    before = {name: one.default for name, one in declared_of(DETECTOR).items() if one.is_live}
    nodes.set(DETECTOR, **before | {'registered_ids': EMPTY})


@pytest.mark.parametrize('node', [DRIVER, DETECTOR, COFFEE, HEARTBEAT])
def test_parameters_are_as_declared_and_only_live_ones_may_be_set(nodes: Live, node: str) -> None:
    before = nodes.services.get(node)
    assert set(before) == set(declared_of(node))
    for descriptor in nodes.services.describe(node):
        one = declared_of(node)[descriptor.name]
        assert descriptor.description == one.description
        assert descriptor.additional_constraints == one.constraints()
        assert descriptor.read_only == (not one.is_live)
        ranges = [*descriptor.integer_range, *descriptor.floating_point_range]
        limits = [] if isinstance(one.default, list) or not one.limits else [one.limits]
        assert [(limit.from_value, limit.to_value) for limit in ranges] == limits
        name = descriptor.name
        (result,) = nodes.services.try_to_set(node, **{name: before[name]})
        assert result.successful == one.is_live, result.reason
        assert one.is_live or f'a read-only parameter: {name}' in result.reason
    assert nodes.services.get(node) == before
    assert before.get('registered_ids', EMPTY) == EMPTY  # an empty list is a value like any other


@pytest.mark.parametrize('method', METHODS)
def test_a_method_reads_all_or_the_allowed_only(live: Live, method: str) -> None:
    live.set(DETECTOR, method=method)
    live.wait_for_readings(1, *NAMES)
    status = live.system.next_status('detector: markers')
    assert values_of(status)['method'] == method
    for allowed in ({'only_registered': True}, {'registered_ids': [2073, 2096]}):
        live.set(DETECTOR, only_registered=False, registered_ids=EMPTY)
        live.set(DETECTOR, **allowed)
        live.wait_for_readings(3, 2073, 2096)
        assert set(live.read()) == {2073, 2096}


def test_the_file_and_the_list_add_up_and_an_empty_list_of_any_type_allows_all(live: Live) -> None:
    live.set(DETECTOR, only_registered=True, registered_ids=[2107])
    live.wait_for_readings(1, *NAMES)
    for kind in (ParameterType.PARAMETER_BOOL_ARRAY, ParameterType.PARAMETER_STRING_ARRAY):
        live.set(DETECTOR, only_registered=False, registered_ids=[2107])
        live.wait_for_readings(2, 2107)
        assert set(live.read()) == {2107}
        live.set(DETECTOR, registered_ids=ParameterValue(type=kind))
        live.wait_for_readings(1, *NAMES)


def test_transforms_and_shapes_change_at_once(live: Live) -> None:
    live.set(DETECTOR, publish_tf=False, stale_after=7.25)
    with live.system.subscribed(MarkerArray, 'marker_array') as arrays:
        live.wait_for_readings(2, *NAMES)
        live.system.wait(lambda: bool(arrays), 'shapes')
    assert live.transformed() == []
    for shape in arrays[0].markers:
        assert (shape.lifetime.sec, shape.lifetime.nanosec) == (7, 250_000_000)
    live.set(DETECTOR, publish_tf=True)
    live.system.wait(lambda: live.transformed() == sorted(NAMES.values()), 'transforms')


def test_a_wrong_bit_period_is_reported_and_candidates_are_logged_for_debugging(live: Live) -> None:
    live.set(DETECTOR, bit_period=0.084)
    status = live.system.wait_for_status('detector: markers', DiagnosticStatus.WARN, 'with bits of')
    advice = r'with bits of 4[12]\.\d ms, not of 84.0 ms: set bit_period to 0.04'
    assert re.search(advice, status.message)
    reasons = '|'.join(reason.value for reason in Reason)
    rejected = rf'rejected: ({reasons}): ID \d+, evidence \S+, word \S+, margin \S+ nats'
    assert re.search(rejected, live.system.log('detector'))
    live.set(DETECTOR, bit_period=0.015)
    mistimed = 'a frame comes every'
    for _ in range(2):
        live.system.wait_for_status('detector: markers', DiagnosticStatus.WARN, mistimed)
    assert live.system.log('detector').count(mistimed) == 1  # /diagnostics repeats it


def test_readings_with_which_too_few_agree_are_counted_and_not_published(live: Live) -> None:
    live.set(DETECTOR, min_readings=100)
    live.system.wait(
        lambda: live.system.number('detector: markers', 'withheld by min_readings') > 2, 'readings'
    )
    assert not live.read()
    live.set(DETECTOR, min_readings=1)
    live.wait_for_readings(1, *NAMES)
    assert live.system.number('detector: markers', 'withheld by min_readings') == 0


def test_a_detector_without_frames_or_a_marker_file(live: Live) -> None:
    name = '/bare/detector: markers'
    live.system.wait_for_status(name, DiagnosticStatus.WARN, 'no frame has come yet')
    (result,) = live.services.try_to_set(BARE, only_registered=True)
    assert not result.successful
    assert result.reason == 'only_registered: there is no marker_file with markers'
    live.set(BARE, publish_tf=True)  # which it did not from the start
    with (
        live.system.subscribed(MarkerDetection, '/bare/markers') as readings,
        live.system.fed('/bare/frames'),
    ):
        live.system.wait(lambda: {one.id for one in readings} >= set(NAMES), 'all markers')
        live.system.wait_for_transforms('marker_2073')
    live.set(BARE, publish_tf=False)


# By rclpy itself, by the declaration, and by the detector.
REFUSED: list[tuple[dict[str, Any], str]] = [
    ({'max_packets': 2.0}, 'Wrong parameter type'),
    ({'noise_floor': math.nan}, 'noise_floor out of range'),
    ({'registered_ids': ParameterValue()}, 'registered_ids: None is not a list'),
    ({'registered_ids': [7, 0]}, 'registered_ids holds 0, which no marker sends'),
    ({'method': ParameterValue()}, 'cannot be undeclared'),
]


def test_what_is_refused_changes_nothing(nodes: Live) -> None:
    before = nodes.services.get(DETECTOR)
    for changes, reason in REFUSED:
        (result,) = nodes.services.try_to_set(DETECTOR, **changes)
        assert not result.successful, changes
        assert reason in result.reason
        assert '\n' not in result.reason
        assert nodes.services.get(DETECTOR) == before


def test_parameters_set_at_once_are_all_refused_if_one_is(live: Live) -> None:
    before = live.services.get(DETECTOR)
    changes = {'publish_tf': False, 'method': 'paper', 'registered_ids': [0]}
    service, kind = f'{DETECTOR}/set_parameters_atomically', SetParametersAtomically
    request = kind.Request(parameters=parameter_messages(changes))
    result = live.services.call(kind, service, request).result
    assert not result.successful
    assert 'registered_ids holds 0' in result.reason
    live.set(DETECTOR, stale_after=5.0)  # does not bring them after all
    assert live.services.get(DETECTOR) == before | live.services.get(DETECTOR, 'stale_after')
    live.wait_for_readings(1, *NAMES)
    live.system.wait(lambda: bool(live.transformed()), 'transforms')


def test_limits_of_all_ranges_do_not_end_the_node(live: Live) -> None:
    """Bits of 2 ms or 10 s read nothing, but they do not end the node."""
    for descriptor in live.services.describe(DETECTOR):
        name = descriptor.name
        limits = [*descriptor.integer_range, *descriptor.floating_point_range]
        for value in [end for limit in limits for end in (limit.from_value, limit.to_value)]:
            live.services.set(DETECTOR, **{name: value})
            live.system.pass_time(0.1)
        if limits:
            live.set(DETECTOR, **{name: declared_of(DETECTOR)[name].default})
    live.wait_for_readings(1, *NAMES)


def test_a_new_transport_delay_is_subtracted_at_once(nodes: Live) -> None:
    system = nodes.system

    def error_s() -> float:
        """Return the median error of the stamps of the next frames."""
        with system.subscribed(FrameMsg, '/real/frames') as frames:
            system.wait(lambda: len(frames) >= 25, 'frames')
        off_ns = [to_ns(one.header.stamp) - sensor.middle_ns[one.sequence] for one in frames[:20]]
        return float(np.median(off_ns)) * 1e-9

    with Sensor(load_scene('coffee'), system.port) as sensor:
        system.wait(lambda: len(sensor.middle_ns) > 25, 'the driver to listen')
        before_s = error_s()
        assert abs(before_s) < 0.02
        nodes.set(DRIVER, transport_delay=0.0505)
        assert error_s() - before_s == pytest.approx(-0.04, abs=0.01)
        (result,) = nodes.services.try_to_set(DRIVER, transport_delay=-0.1)
        assert 'transport_delay out of range' in result.reason
        nodes.set(DRIVER, transport_delay=0.0105)
        assert error_s() == pytest.approx(before_s, abs=0.01)
