# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What hosts and viewers of the project need, and drawings: all name what there is."""

import json
import re
import runpy
import subprocess
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from harness_firmware import FIRMWARE, ROOT

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.settings.files import load_yaml, shared_file

FOLDERS = '|'.join(path.name for path in ROOT.iterdir() if path.is_dir())


def test_one_line_sets_all_addresses_of_the_package(tmp_path: Path) -> None:
    package = tmp_path / 'package.xml'
    package.write_bytes((ROOT / 'package.xml').read_bytes())
    (line,) = re.findall('^    (sed .+)', (ROOT / 'CONTRIBUTING.md').read_text(), re.M)
    subprocess.run(line, shell=True, check=True, cwd=tmp_path)
    root = ElementTree.parse(package).getroot()
    address = 'https://github.com/you/retrolidar_ros'
    assert {url.get('type'): url.text for url in root.findall('url')} == {
        'website': f'{address}#readme',
        'repository': address,
        'bugtracker': f'{address}/issues',
    }
    assert root.findtext('author')


def test_what_the_workflow_runs_is_there() -> None:
    jobs = load_yaml(ROOT / '.github/workflows/ros.yaml')['jobs']
    assert set(jobs) == {'colcon', 'lint', 'sanitizers', 'docker'}
    rows = jobs['colcon']['strategy']['matrix']['include']
    assert {row['distro'] for row in rows} == {'humble', 'jazzy', 'kilted', 'lyrical'}
    lines = [step['run'] for job in jobs.values() for step in job['steps'] if 'run' in step]
    paths = re.findall(rf'(?<![\w/])(?:{FOLDERS})/\S+', '\n'.join(lines))
    assert {'embedded/run', 'test/firmware'} <= {*paths}
    for path in paths:
        assert path.startswith('install/') or (ROOT / path).exists(), path
    targets = re.findall(r'^make (\w+)$', '\n'.join(lines), re.M)
    assert set(targets) == {'lint', 'build'}


def test_the_image_is_built_of_ros_alone_and_its_commands_can_be_parsed() -> None:
    text = (ROOT / 'Dockerfile').read_text().replace('\\\n', '')
    steps = dict(re.findall(r'^([A-Z]+) (.+)$', text, re.M))
    assert steps['FROM'] == 'ros:jazzy'
    subprocess.run(['bash', '-n', '-c', steps['RUN']], check=True)
    source, target = steps['COPY'].split()
    assert (source, target) == ('.', 'src/retrolidar_ros')
    ignored = (ROOT / '.dockerignore').read_text().split()
    assert {'.venv', 'build', 'install', 'log'} <= {*ignored}


IMAGES = ROOT / 'docs' / 'images'


@pytest.mark.parametrize('name', ['viewers', 'overview'])
def test_a_drawing_is_that_of_its_script(name: str) -> None:
    """`embedded/run python docs/images/NAME.py` draws it again."""
    module = runpy.run_path(str(IMAGES / f'{name}.py'))
    assert module['drawing']() == (IMAGES / f'{name}.svg').read_text(encoding='utf-8')


@pytest.mark.parametrize('sketch', ['reader', 'marker'])
def test_a_drawing_names_the_pins_of_its_sketch(sketch: str) -> None:
    source = (FIRMWARE / sketch / f'{sketch}.ino').read_text(encoding='utf-8')
    drawing = (IMAGES / f'hardware_{sketch}.svg').read_text(encoding='utf-8')
    pins = re.findall(r'_PIN = (\w+)', source)
    assert pins
    for pin in pins:
        assert re.search(rf'>{pin}\b', drawing), pin


def test_the_schematic_has_the_pins_of_the_sketch_and_the_parts_of_the_bill() -> None:
    source = (FIRMWARE / 'marker' / 'marker.ino').read_text(encoding='utf-8')
    page = (ROOT / 'docs' / 'hardware.md').read_text(encoding='utf-8')
    drawing = (IMAGES / 'hardware_schematic.svg').read_text(encoding='utf-8')
    drawn = set(re.findall(r'class="n">([A-Z]+\d+)[AB]?<', drawing))
    bill = page.partition('images/hardware_schematic.svg')[2].partition('\n\nA marker')[0]
    assert drawn == set(re.findall(r'\b((?:R|C|U|PD|CR|P)\d+)\b', bill))
    pins = {*re.findall(r'_PIN = (\w+)', source), '5V'}
    assert set(re.findall(r'class="pin">(\w+)<', drawing)) == pins
    for part in ('74AHCT125', 'BPW34 FA', 'OPA320', 'SMS7630', 'TLV7031'):
        assert part in drawing
        assert part in bill


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


@pytest.mark.parametrize('content', [RVIZ, FOXGLOVE], ids=['rviz', 'foxglove'])
def test_the_topics_are_those_of_the_reference(content: Any) -> None:
    reference = (ROOT / 'docs' / 'reference.md').read_text(encoding='utf-8')
    known = dict(re.findall(r'^\| `(/\S+)` \| ([^|]+) \|', reference, re.M))
    named = set(re.findall(r'"(/[a-z][^".]*)', json.dumps(content)))
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


def rotation(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the matrix of URDF's angles: about the fixed axes x, then y, then z."""
    about_x, about_y, about_z = map(matrix_of_turn, np.diag([roll, pitch, yaw]))
    return about_z @ about_y @ about_x


OPTICAL = np.transpose([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Right, down and ahead of the sensor, in a frame with x forward, y left and z up."""


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
    np.testing.assert_allclose(turn, OPTICAL, atol=1e-9)


def test_the_documented_mounting_looks_ahead() -> None:
    file = ROOT / 'docs' / 'troubleshooting.md'
    (line,) = (x for x in file.read_text().splitlines() if 'static_transform_publisher' in x)
    angles = {name: float(value) for name, value in re.findall(r'--(roll|pitch|yaw) (\S+)', line)}
    turn = rotation(*(angles.get(name, 0.0) for name in ('roll', 'pitch', 'yaw')))
    np.testing.assert_allclose(turn, OPTICAL, atol=1e-6)
