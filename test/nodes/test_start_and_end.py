# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How the executables start, what they refuse at the start, and how they end."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from harness_nodes import refusal, running

from retrolidar_ros.cli.demo import executable

FILES = {
    'broken': '/**:\n  ros__parameters:\n    method: [joint',
    'twice': 'markers:\n  2073: {frame: a}\n  2073: {frame: b}\n',
    'same': 'markers: {2073: {frame: mug}, 2096: {frame: mug}}\n',
}


@pytest.mark.parametrize(
    ('node', 'arguments', 'message'),
    [
        ('driver', '--params-file {}/nowhere.yaml', 'nowhere.yaml'),
        ('driver', '-p serial_baud:=fast', "'serial_baud' to 'fast' of type 'STRING'"),
        ('driver', '-p protocol:=magic', "protocol: 'magic' is not one of retrolidar, st_example"),
        ('driver', "-p frame_id:=''", 'frame_id'),
        ('detector', '--params-file {}/broken.yaml', 'broken.yaml'),
        ('detector', '-p method:=magic', "method: 'magic' is not one of joint, paper"),
        ('detector', '-p bit_period:=-1.0', 'bit_period out of range'),
        ('detector', '-p max_packets:=9', 'max_packets out of range'),
        ('detector', '-p registered_ids:=[7,5000]', 'registered_ids: 5000 is not within 0 to 4095'),
        ('detector', '-p registered_ids:=7', 'registered_ids'),
        ('detector', '-p marker_file:={}/nowhere.yaml', 'marker_file: [Errno 2] No such file'),
        ('detector', '-p marker_file:={}/twice.yaml', 'key 2073 stands here a second time'),
        ('detector', '-p marker_file:={}/same.yaml', 'marker 2073 has the frame mug, too'),
        ('detector', '-p only_registered:=true', 'only_registered: there is no marker_file'),
        ('detector', '-p child_frame:=left', "child_frame: 'left' needs {name} once"),
        ('coffee', '-p objects:=[]', 'objects: there is no name'),
        ('heartbeat', '-p markers:=[]', 'markers: there is no name'),
        ('reader', '-p ports:=[/a,/b] -p names:=[x]', 'names: 1 of them for 2 ports'),
        ('reader', '-p ports:=[/a,/a]', 'ports: one stands there twice'),
        ('reader', '-p frame_id:=/odom', "'/odom' begins with a slash, which tf2 refuses"),
    ],
)
def test_what_cannot_be_is_one_clear_line(
    node: str, arguments: str, message: str, tmp_path: Path
) -> None:
    for name, text in FILES.items():
        (tmp_path / f'{name}.yaml').write_text(text)
    lines = refusal(node, *arguments.replace('{}', str(tmp_path)).split())
    output = '\n'.join(lines)
    assert output.count(message) == 1, output
    written = [line for line in lines if not re.search(r'\[rcl\]: Failed to parse|\[INFO\]', line)]
    assert len(written) - ('twice.yaml' in output) == 1, output


def warnings_of(directory: Path, node: str, *arguments: str, reliability: str) -> list[str]:
    """Return what a node warns of until SIGTERM ends it, which it must do in order."""
    topic, status = {
        'driver': ('frames', 'driver: frames'),
        'detector': ('markers', 'detector: markers'),
    }[node]
    with running(directory, '/ending') as system:
        system.start(node, *arguments)
        system.next_status(status)
        (publisher,) = system.node.get_publishers_info_by_topic(f'/ending/{topic}')
        assert publisher.qos_profile.reliability.name == reliability
        system.stop(node, signal.SIGTERM)
        return [line for line in system.log(node).splitlines() if 'is unknown' in line]


def test_qualities_of_service_may_be_overridden(tmp_path: Path) -> None:
    topic = 'qos_overrides./ending/frames.publisher'
    elsewhere = 'qos_overrides./nowhere.depth'
    values = (f'{topic}.reliability:=best_effort', f'{topic}.depht:=3', f'{elsewhere}:=3')
    given = [part for one in values for part in ('-p', one)]
    unknown = warnings_of(tmp_path, 'driver', *given, reliability='BEST_EFFORT')
    assert any(f'{topic}.depht is unknown; did you mean {topic}.depth?' in one for one in unknown)
    assert any(f'{elsewhere} is unknown' in one for one in unknown)


@pytest.mark.parametrize(
    ('node', 'text', 'expected'),
    [
        ('detector', '/**:\n  ros__parameters: {use_sim_time: false, robot_name: r2}', []),
        ('driver', '/**:\n  ros__parameters: {robot_name: r2, method: paper}', []),
        ('driver', '/**/driver:\n  ros__parameters: {robot_name: r2}', ['robot_name']),
        ('driver', '/**:\n  ros__parameters: {serial_prt: x}', ['serial_prt is unknown; did you']),
    ],
)
def test_parameters_for_all_nodes_draw_no_false_warnings(
    node: str, text: str, expected: list[str], tmp_path: Path
) -> None:
    file = tmp_path / 'all.yaml'
    file.write_text(text)
    warnings = warnings_of(tmp_path, node, '--params-file', str(file), reliability='RELIABLE')
    assert len(warnings) == len(expected), warnings
    assert all(text in line for text, line in zip(expected, warnings, strict=True))


SPY = """
import os, runpy, sys

class Spy:
    def find_spec(self, name, path=None, target=None):
        if name == 'numpy':
            print('threads:', os.environ.get('OPENBLAS_NUM_THREADS'))

sys.meta_path.insert(0, Spy())
runpy.run_path(sys.argv[1], run_name='__main__')
"""


@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('detector', ['--ros-args', '-p', 'method:=magic']),
        ('retrolidar', ['decode', 'nowhere']),
    ],
)
def test_numpy_has_one_thread_from_its_import_on(
    name: str, arguments: list[str], tmp_path: Path
) -> None:
    result = subprocess.run(
        [sys.executable, '-c', SPY, executable(name), *arguments],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
        env={key: value for key, value in os.environ.items() if 'NUM_THREADS' not in key},
        cwd=tmp_path,  # here would be the sources, without the messages
    )
    assert result.returncode == 2
    assert result.stdout.splitlines()[0] == 'threads: 1'
