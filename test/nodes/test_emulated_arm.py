# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The emulated arm: it sends the pose of the sensor unless another arm does; and its demo."""

import json
import re
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from harness import Sensor
from harness_observer import RELIABLE, running
from harness_tasks import BASE_VIEW, SENSOR_FRAME, publish_base
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import quaternion_in, to_ns, vector_of
from retrolidar_ros.nodes.emulated_arm import IN_BASE
from retrolidar_ros.scene.description import find_scene, load_scene
from retrolidar_ros.sensor.rotation import matrix_of
from retrolidar_ros.settings.files import load_yaml

SCENE = load_scene('arm')


def transforms_of(came: list[TFMessage]) -> list[TransformStamped]:
    found = [one for message in came for one in message.transforms]
    return [one for one in found if one.child_frame_id == SENSOR_FRAME]


def test_it_sends_the_pose_of_the_sensor_and_a_description(tmp_path: Path) -> None:
    first_m, second_m = (np.array(SCENE.sensor.path[index].position_m) for index in (0, 2))
    with running(tmp_path, '/arm_alone') as system:
        system.start('driver', serial_port=system.port)
        # What hears it is there before it, so that its first message is not missed.
        sent = system.collect(TFMessage, '/tf', RELIABLE)
        description = system.collect(String, 'robot_description')
        # The scene has begun 5.5 s ago, so the hand moves on in half a second.
        start_s = time.monotonic() - 5.5
        system.start('emulated_arm', scene='arm', start=start_s, fixed_frame='stand')

        def is_there() -> bool:
            found = transforms_of(sent)
            at_m = vector_of(found[-1].transform.translation) if found else np.zeros(3)
            return np.allclose(at_m, IN_BASE @ second_m)

        system.wait(lambda: system.node.count_publishers('/tf') > 0, 'the arm')
        # An answer shows that it knows what hears it: the client of the service is newer.
        system.services.names('/arm_alone/emulated_arm')
        with Sensor(SCENE, system.port):
            system.wait(lambda: bool(description), 'a robot description')
            system.wait(is_there, 'the second place')
    robot = ElementTree.fromstring(description[-1].data)
    assert {one.get('name') for one in robot.iter('link')} == {'stand', SENSOR_FRAME}
    found = transforms_of(sent)
    assert {one.header.frame_id for one in found} == {'stand'}
    stamps = np.array([to_ns(one.header.stamp) for one in found])
    assert (np.diff(stamps) > 0).all()
    # Readings of before it has sent anything wait for their poses.
    at_once = [to_ns(one.header.stamp) for one in transforms_of(sent[:1])]
    assert at_once[-1] - at_once[0] > 5e9
    first = found[0].transform
    assert vector_of(first.translation) == pytest.approx(IN_BASE @ first_m)
    last = found[-1].transform
    assert vector_of(last.translation) == pytest.approx(IN_BASE @ second_m)
    assert not np.allclose(IN_BASE @ first_m, IN_BASE @ second_m)
    # The sensor looks ahead, 14 degrees to the right.
    ahead = matrix_of(quaternion_in(last.rotation))[:, 2]
    assert ahead[0] > 0.9
    assert np.degrees(np.arctan2(ahead[1], ahead[0])) == pytest.approx(-14)


def test_an_arm_that_is_there_already_is_used(tmp_path: Path) -> None:
    with running(tmp_path, '/arm_other') as system:
        publish_base(system)
        system.start('driver', serial_port=system.port)
        system.start('emulated_arm', scene='arm', fixed_frame=BASE_VIEW.frame)
        with Sensor(SCENE, system.port):
            told = f'{SENSOR_FRAME} has another parent in TF: that arm is used'
            system.wait(lambda: told in system.log('emulated_arm'), told)
            told_ns = time.time_ns()
            system.pass_time(0.5)
        sent = [one for one in system.transforms if one.child_frame_id == SENSOR_FRAME]
        assert all(to_ns(one.header.stamp) <= told_ns for one in sent)


def test_objects_are_known_better_after_a_second_place(tmp_path: Path) -> None:
    scene = load_yaml(find_scene('arm'))
    here, _, _, _, _, _, there, *_ = scene['sensor']['path']
    times = (0, 6, 7, 11)
    scene['sensor']['path'] = [
        {**place, 'time': f'{time_s} s'}
        for place, time_s in zip((here, here, there, there), times, strict=True)
    ]
    file, picture = tmp_path / 'short.yaml', tmp_path / 'short.png'
    file.write_text(json.dumps(scene))  # YAML without aliases
    command = [sys.executable, '-m', 'retrolidar_ros.cli', 'demo', str(file), '-o', str(picture)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=90, cwd=tmp_path)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert '3 of 3 objects are in their 99.9 % ellipsoid' in ended.stdout
    assert picture.stat().st_size > 10_000
    spreads = [
        [float(one) for one in re.findall(r'± +([\d.]+)', line)]
        for line in re.findall(r'^  \d\. .*$', ended.stdout, re.MULTILINE)
    ]
    assert [len(one) for one in spreads] == [3, 3]
    assert all(later < first for first, later in zip(*spreads, strict=True))
