# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a host of the project needs, and drawings: of their scripts, sketches and bill of parts."""

import re
import runpy
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest
from harness_firmware import FIRMWARE, ROOT

from retrolidar_ros.settings.yaml_files import load_yaml

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


def test_the_layouts_are_drawn_from_their_files() -> None:
    """`embedded/run python docs/images/viewers.py` draws them again."""
    module = runpy.run_path(str(IMAGES / 'viewers.py'))
    assert module['drawing']() == (IMAGES / 'viewers.svg').read_text(encoding='utf-8')


def test_the_overview_is_that_of_its_script() -> None:
    """`embedded/run python docs/images/overview.py` draws it again."""
    module = runpy.run_path(str(IMAGES / 'overview.py'))
    assert module['drawing']() == (IMAGES / 'overview.svg').read_text(encoding='utf-8')


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
    assert set(re.findall(r'class="pin">(\w+)<', drawing)) == {
        *re.findall(r'_PIN = (\w+)', source),
        '5V',
    }
    for part in ('74AHCT125', 'BPW34 FA', 'OPA320', 'SMS7630', 'TLV7031'):
        assert part in drawing
        assert part in bill
