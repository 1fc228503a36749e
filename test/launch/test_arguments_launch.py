# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Impossible launch arguments: the launch ends and names them; and what RViz is given."""

import os
import signal
import subprocess
import sys
import tempfile
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import patch

import pytest
import yaml

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

import launch_testing.actions
from launch import LaunchContext, LaunchDescription
from launch.launch_description_sources import get_launch_description_from_any_launch_file
from launch.utilities import perform_substitutions
from launch_ros.actions import Node
from launch_testing.util import KeepAliveProc

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness_observer import Observer, processes

from retrolidar_ros.settings.files import shared_file

NAMESPACE = f'wrongly_launched_{os.getpid()}_'
EMPTY = Path(tempfile.mkdtemp(), 'empty_section.yaml')
EMPTY.write_text('/**:\n  ros__parameters: {}\n/**/driver:\n')
SECTIONS = EMPTY.with_name('sections.yaml')
SECTIONS.write_text(
    '/shown/driver:\n  ros__parameters: {frame_id: own}\n'
    '/elsewhere/driver:\n  ros__parameters: {frame_id: other}\n'
    '/**/detecter:\n  ros__parameters: {}\n'
)
SCRIPT = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from retrolidar_ros.settings.files import shared_file

arguments = [argument.split(':=', 1) for argument in sys.argv[2:]]
include = IncludeLaunchDescription(str(shared_file(f'launch/{sys.argv[1]}.launch.py')),
                                   launch_arguments=arguments)
service = LaunchService()
service.include_launch_description(LaunchDescription([include]))
sys.exit(service.run())
"""
"""Launches a file of the package: its name, and arguments."""
_AT_ONCE = 3
WRONG = {
    'coffee': ['max_stddev:=x', 'respawn_delay:=-1', 'log_level:=loud', 'emulate:=nowhere'],
    'landmarks': ['localize:=perhaps', 'params_file:=/etc/passwd', 'params_file:=/nowhere'],
    'retrolidar': ['marker_file:=/nowhere.yaml', f'params_file:={EMPTY}', 'protocol:=st_example'],
    'two_sensors': ['right_emulate:=nowhere', 'marker_file:=/etc/passwd', 'protocol:=foo'],
    'drone': ['edge:=wide', 'ports:=[a', 'sensors:=2', 'marker_file:=/nowhere.yaml'],
    'hall': ['names:=left', 'names:=[x, y]', 'names:=[left, on]', 'rviz:=perhaps'],
}


@pytest.mark.launch_test
def generate_test_description():
    return LaunchDescription([KeepAliveProc(), launch_testing.actions.ReadyToTest()])


def pretend_that_rviz_is_installed():
    """Make a package `rviz2` that is found in this process."""
    directory = Path(tempfile.mkdtemp(prefix='retrolidar_'))
    index = directory / 'share' / 'ament_index' / 'resource_index' / 'packages' / 'rviz2'
    executable = directory / 'lib' / 'rviz2' / 'rviz2'
    for path in (index, executable):
        path.parent.mkdir(parents=True)
        path.touch(0o755)
    return patch.dict(
        os.environ, {'AMENT_PREFIX_PATH': f'{directory}:{os.environ["AMENT_PREFIX_PATH"]}'}
    )


def topics_of(file):
    displays = yaml.safe_load(file.read_text())['Visualization Manager']['Displays']
    places = [one.get('Topic', one.get('Description Topic', {})) for one in displays]
    return {place['Value'] for place in places if place}


def shown_by(name, **arguments):
    """Return the file that a launch file has RViz show; nothing is started."""
    file = str(shared_file(f'launch/{name}.launch.py'))
    context = LaunchContext()
    context.launch_configurations.update(arguments, rviz='true')
    entities = get_launch_description_from_any_launch_file(file).entities
    actions = [action for one in entities for action in one.execute(context) or []]
    (rviz,) = [one for one in actions if isinstance(one, Node) and one.node_executable == 'rviz2']
    words = [perform_substitutions(context, part) for part in rviz.cmd]
    return Path(words[words.index('-d') + 1])


class TestArguments(unittest.TestCase):
    """One that is wrong in each launch, where the rest is right; and `rviz`."""

    def test_wrong_ones_are_named_and_leave_no_process_behind(self):
        right = {
            'two_sensors': ['left_emulate:=coffee', 'right_emulate:=coffee'],
            'drone': ['emulate:=drone', 'sensors:=3'],
            'hall': [],
        }
        wrong = [(name, argument) for name, arguments in WRONG.items() for argument in arguments]

        def launch(case):
            (name, argument), namespace = case, f'{NAMESPACE}{wrong.index(case)}'
            given = [*right.get(name, ['emulate:=coffee']), argument]
            command = [sys.executable, '-c', SCRIPT, name, f'namespace:={namespace}', *given]
            return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

        with ThreadPoolExecutor(_AT_ONCE) as pool:
            results = list(pool.map(launch, wrong))
        for (name, argument), result in zip(wrong, results, strict=True):
            with self.subTest(name=name, argument=argument):
                output = result.stdout + result.stderr
                assert result.returncode == 1, output
                assert argument.partition(':=')[2] in output
                assert 'process started' not in output
        assert not [line for _, line in processes() if f'__ns:=/{NAMESPACE}' in line]

    def test_a_misconfigured_node_is_not_started_again(self):
        """The others go on, until the launch is interrupted."""
        arguments = [
            f'params_file:={SECTIONS}',
            'child_frame:=nameless',
            'emulate:=coffee',
            'respawn_delay:=0.0',
        ]
        command = [sys.executable, '-c', SCRIPT, 'retrolidar', f'namespace:={NAMESPACE}']
        launch = subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True)
        self.addCleanup(launch.send_signal, signal.SIGINT)
        told, lines = 'is misconfigured, see above: it is not started again', []
        while not lines or told not in lines[-1]:
            lines.append(launch.stdout.readline())
            assert lines[-1], lines
        observer = Observer(f'/{NAMESPACE}')
        self.addCleanup(observer.close)
        observer.wait_for_frames(150)
        launch.send_signal(signal.SIGINT)
        output = ''.join([*lines, launch.communicate(timeout=60)[0]])
        assert output.count('/**/detecter is none of these nodes; did you mean detector?') == 1
        assert output.count('FATAL') == output.count(told) == 1, output
        assert not [line for _, line in processes() if f'__ns:=/{NAMESPACE}' in line]

    def test_every_launch_file_shows_its_topics_in_its_frame(self):
        of_sensor = {'points', 'marker_array', 'signal_image'}
        both = {f'{side}/{one}' for side in ('left', 'right') for one in of_sensor}
        arm = {*of_sensor, 'robot_description'}
        for name, arguments, topics, frame in (
            ('retrolidar', {'frame_id': 'gripper'}, of_sensor, 'gripper'),
            ('retrolidar', {'params_file': str(SECTIONS)}, of_sensor, 'own'),
            ('coffee', {'emulate': 'arm'}, arm, 'base_link'),
            ('landmarks', {}, {*arm, 'landmarks/marker_array'}, 'base_link'),
            ('two_sensors', {}, both, 'left_optical_frame'),
            ('hall', {'params_file': str(SECTIONS)}, of_sensor, 'own'),
            ('hall', {'ports': '[/a, /b]', 'names': '[left, right]'}, both, 'left_optical_frame'),
        ):
            with self.subTest(name=name), pretend_that_rviz_is_installed():
                file = shown_by(name, namespace='shown', **arguments)
                assert topics_of(file) == {f'/shown/{one}' for one in topics}
                assert f'Fixed Frame: {frame}\n' in file.read_text()
