# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The settings for RViz and Foxglove, and the description of the sensor, name what there is."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.settings.parameter import declared
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_yaml

SENSOR = declared()['driver']['frame_id'].default
RVIZ = load_yaml(shared_file('config/retrolidar.rviz'))['Visualization Manager']
DISPLAYS = {one['Class'].removeprefix('rviz_default_plugins/'): one for one in RVIZ['Displays']}
FOXGLOVE = json.loads(shared_file('config/foxglove.json').read_text(encoding='utf-8'))
PANELS = {key.partition('!')[0]: panel for key, panel in FOXGLOVE['configById'].items()}

TYPES = {
    '/tf': 'TFMessage',
    '/diagnostics': 'DiagnosticArray',
    '/retrolidar/markers': 'MarkerDetection',
    '/retrolidar/points': 'PointCloud2',
    '/retrolidar/marker_array': 'MarkerArray',
    '/retrolidar/signal_image': 'Image',
}


def strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for key, one in value.items():
            yield from strings(key)
            yield from strings(one)
    elif isinstance(value, list):
        for one in value:
            yield from strings(one)


def topics(content: Any) -> set[str]:
    return {text.partition('.')[0] for text in strings(content) if re.match(r'/[a-z]', text)}


def documented_topics() -> dict[str, str]:
    reference = Path(__file__).parents[2] / 'docs' / 'reference.md'
    rows = re.findall(r'^\| `(/\S+)` \| ([^|]+) \|', reference.read_text(encoding='utf-8'), re.M)
    return dict(rows)


@pytest.mark.parametrize('content', [RVIZ, FOXGLOVE], ids=['rviz', 'foxglove'])
def test_the_topics_are_those_of_the_reference(content: Any) -> None:
    known = documented_topics()
    named = topics(content)
    assert named
    for topic in named:
        assert topic in known, f'{topic} is not in the table of topics'
        assert re.search(rf'\b{TYPES[topic]}\b', known[topic]), f'{topic} is a {known[topic]}'


def test_each_display_shows_topics_of_its_type() -> None:
    for kind in ('PointCloud2', 'MarkerArray', 'Image'):
        topic = DISPLAYS[kind]['Topic']
        assert TYPES[topic['Value']] == kind
        # All publishers are reliable and volatile.
        assert topic['Durability Policy'] == 'Volatile'
    assert TYPES[PANELS['Image']['imageMode']['imageTopic']] == 'Image'
    assert TYPES[PANELS['DiagnosticSummary']['topicToRender']] == 'DiagnosticArray'
    assert TYPES[PANELS['RawMessages']['topicPath']] == 'MarkerDetection'
    message = shared_file('msg/MarkerDetection.msg').read_text(encoding='utf-8')
    fields = set(re.findall(r'^\w[\w/]*(?:\[\])? (\w+)', message, re.M))
    for path in PANELS['Plot']['paths']:
        topic, _, field = path['value'].partition('.')
        assert (TYPES[topic], field in fields) == ('MarkerDetection', True)


ROOT = Path(__file__).resolve().parents[2]


def rotation(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the matrix of URDF's angles: about the fixed axes x, then y, then z."""
    about_x, about_y, about_z = map(matrix_of_turn, np.diag([roll, pitch, yaw]))
    turn: Floats = about_z @ about_y @ about_x
    return turn


def test_the_optical_frame_looks_along_the_x_of_its_link() -> None:
    """REP 103: what is ahead of the sensor is at z of the optical frame, its right at x."""
    robot = ElementTree.parse(shared_file('urdf/retrolidar.urdf.xacro')).getroot()
    (joint,) = (j for j in robot.iter('joint') if j.get('name') == '${name}_optical_joint')
    origin, parent, child = (joint.find(tag) for tag in ('origin', 'parent', 'child'))
    assert origin is not None
    assert parent is not None
    assert child is not None
    assert (parent.get('link'), child.get('link')) == ('${name}_link', '${name}_optical_frame')
    turn = rotation(*map(float, str(origin.get('rpy')).split()))
    right, down, ahead = turn.T
    assert ahead == pytest.approx([1, 0, 0], abs=1e-9)
    assert right == pytest.approx([0, -1, 0], abs=1e-9)
    assert down == pytest.approx([0, 0, -1], abs=1e-9)


def test_the_documented_mounting_looks_ahead() -> None:
    file = ROOT / 'docs' / 'troubleshooting.md'
    (line,) = (x for x in file.read_text().splitlines() if 'static_transform_publisher' in x)
    angles = {name: float(value) for name, value in re.findall(r'--(roll|pitch|yaw) (\S+)', line)}
    turn = rotation(*(angles.get(name, 0.0) for name in ('roll', 'pitch', 'yaw')))
    assert turn[:, 2] == pytest.approx([1, 0, 0], abs=1e-6)
    assert turn[:, 0] == pytest.approx([0, -1, 0], abs=1e-6)
