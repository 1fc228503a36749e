# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a host of the project needs: addresses, linters, the jobs of the workflow, the image."""

import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

from retrolidar_ros.settings.yaml_files import load_yaml

ROOT = Path(__file__).parents[2]
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
