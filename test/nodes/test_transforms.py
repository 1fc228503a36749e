# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""TF: lookups, by tf2_ros or the part of it in embedded/, and frames that two nodes send."""

import math
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from harness import Sensor, wait_for_readings
from harness_nodes import COFFEE_IDS, running
from harness_observer import LATCHED
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import to_header, to_pose, to_transform
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.transforms import _LISTENING_S, TransformFinder, TransformSender
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Floats


def transform(
    child: str,
    parent: str,
    x_m: float = 1.0,
    stamp_ns: int = 0,
    quaternion: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
) -> TransformStamped:
    pose = to_pose(np.array([x_m, 0.0, 0.0]), np.array(quaternion))
    return to_transform(to_header(stamp_ns, parent), child, pose)


@pytest.fixture
def listener() -> Iterator[Listener]:
    listener = Listener('/finding')
    yield listener
    listener.close()


def test_transforms_are_found_between_frames_and_times_and_forgotten(listener: Listener) -> None:
    finder = TransformFinder(listener.node)
    static = listener.node.create_publisher(TFMessage, '/tf_static', LATCHED)
    static.publish(TFMessage(transforms=[transform('hand', 'map')]))
    moving = listener.node.create_publisher(TFMessage, '/tf', 10)
    turned = (0.0, 0.0, math.sin(0.5), math.cos(0.5))

    def find(target: str, source: str, at_s: float) -> tuple[Floats, Floats] | None:
        return finder.find(target, source, Time(nanoseconds=round(at_s * 1e9)))

    def is_found() -> bool:
        before, after = (round(at_s * 1e9) for at_s in (1.0, 3.0))
        both = [transform('eye', 'hand', 1.0, before), transform('eye', 'hand', 3.0, after, turned)]
        moving.publish(TFMessage(transforms=both))
        return find('map', 'eye', 2.0) is not None

    assert listener.spin_until(is_found, 30.0)
    assert finder.parents() == {'hand': 'map', 'eye': 'hand'}
    found = find('map', 'eye', 2.0)
    assert found is not None
    assert found[0] == pytest.approx([3.0, 0.0, 0.0])
    assert found[1][:, 0] == pytest.approx([math.cos(0.5), math.sin(0.5), 0.0])
    back = find('eye', 'map', 2.0)
    assert back is not None
    assert back[1] @ found[0] + back[0] == pytest.approx(np.zeros(3), abs=1e-9)
    for source, at_s in (('eye', 3.000000001), ('eye', 0.999), ('nowhere', 2.0)):
        assert find('map', source, at_s) is None
    finder.forget()
    assert find('map', 'eye', 2.0) is None
    assert find('map', 'hand', 2.0) is not None


def test_frames_that_other_nodes_send_are_named(
    listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    sender = TransformSender(listener.node)
    sender.open()
    sender.send([transform('mug', 'eye', stamp_ns=1), transform('mug', 'eye', stamp_ns=2)])
    for stamp_ns, child in ((1, 'mug'), (2, 'mug'), (3, 'jug')):
        sender.on_transform(transform(child, 'eye', stamp_ns=stamp_ns))
    assert sender.problem('eye') == ''
    sender.on_transform(transform('mug', 'other_eye', stamp_ns=3))
    assert 'mug (in other_eye): set frame_prefix' in sender.problem('eye')
    assert sender.problem('another eye') == ''
    later_s = time.monotonic() + 100
    monkeypatch.setattr(time, 'monotonic', lambda: later_s)
    assert sender.problem('eye') == ''


def test_what_was_sent_long_before_it_comes_back_is_still_our_own(listener: Listener) -> None:
    sender = TransformSender(listener.node)
    sender.open()
    sender.send([transform('mug', 'eye', stamp_ns=stamp_ns) for stamp_ns in range(10, 2000)])
    sender.on_transform(transform('mug', 'eye', stamp_ns=11))
    assert sender.problem('eye') == ''
    sender.on_transform(transform('mug', 'eye', stamp_ns=5000))
    assert 'mug (in eye)' in sender.problem('eye')


def test_sensors_of_the_same_frames_are_warned_of_until_they_have_prefixes(tmp_path: Path) -> None:
    ports = [tmp_path / 'one', tmp_path / 'other']
    scene, name = load_scene('coffee'), '/same1/detector: markers'
    with running(tmp_path, '/same0') as system, Sensor(scene, ports[0]), Sensor(scene, ports[1]):
        for index, port in enumerate(ports):
            own = {'name': f'reader{index}', 'namespace': f'/same{index}'}
            system.start('reader', **own, serial_port=port)
        status = system.wait_for_status(name, DiagnosticStatus.WARN, 'another node sends the TF')
        assert '(in retrolidar_optical_frame)' in status.message
        assert 'another node sends the TF frames' in system.log('reader1')
        system.stop('reader0')
        system.start('reader', serial_port=ports[0], frame_prefix='robot0/')
        prefixed = {'frame_prefix': 'robot0/', 'markers': '[marker_2073]'}
        system.start('heartbeat', **prefixed)
        system.wait_for_status('heartbeat: markers', DiagnosticStatus.OK, 'are read')
        system.markers.clear()
        wait_for_readings(system, COFFEE_IDS)
        for message, _ in system.markers:
            assert message.header.frame_id == 'robot0/retrolidar_optical_frame'
            assert message.child_frame_id == f'robot0/marker_{message.id}'
        for _ in range(round(_LISTENING_S) + 2):  # it has listened once by then
            status = system.next_status('detector: markers')
            assert 'another node' not in status.message
