# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The settings for RViz and Foxglove name what there is, as far as that is seen without them."""

import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from retrolidar_ros.sensor.frame import Floats
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


def test_foxglove_places_each_panel_once() -> None:
    placed = re.findall(r'\w+![\w-]+', json.dumps(FOXGLOVE['layout']))
    assert sorted(placed) == sorted(FOXGLOVE['configById'])


def rviz_camera() -> tuple[Floats, Floats]:
    """Return the target of the camera, and its way back from there."""
    assert RVIZ['Global Options']['Fixed Frame'] == SENSOR
    view = RVIZ['Views']['Current']
    assert view['Class'] == 'rviz_default_plugins/Orbit'
    assert abs(view['Pitch']) < math.pi / 2 - 0.001
    pitch, yaw = view['Pitch'], view['Yaw']
    away = [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    target = np.array([view['Focal Point'][axis] for axis in 'XYZ'], dtype=float)
    return target, view['Distance'] * np.array(away)


def foxglove_camera() -> tuple[Floats, Floats]:
    """Return the same."""
    scene = PANELS['3D']
    assert scene['followTf'] == SENSOR
    assert {layer['frameId'] for layer in scene['layers'].values()} == {SENSOR}
    camera = scene['cameraState']
    phi, theta = math.radians(camera['phi']), -math.radians(camera['thetaOffset'])
    away = [math.sin(phi) * math.sin(theta), -math.sin(phi) * math.cos(theta), math.cos(phi)]
    return np.array(camera['targetOffset'], dtype=float), camera['distance'] * np.array(away)


@pytest.mark.parametrize('camera', [rviz_camera, foxglove_camera])
def test_it_looks_ahead_from_behind_the_sensor(
    camera: Callable[[], tuple[Floats, Floats]],
) -> None:
    """An orbiting camera sees x on its right, y below, and z ahead."""
    target, away = camera()
    ahead = -away / np.linalg.norm(away)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    assert target[2] + away[2] < 0 < target[2]
    assert right[0] > 0.99
    assert np.cross(ahead, right)[1] > 0.7
    assert ahead[2] > 0.7
