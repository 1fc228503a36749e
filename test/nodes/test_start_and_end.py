# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How the executables start, what they refuse at the start, and how they end."""

import itertools
import os
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from harness_observer import running
from harness_readings import mapped

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.settings.files import yaml_text
from retrolidar_ros.tasks.survey_files import survey_content

FILES = {
    'broken': '/**:\n  ros__parameters:\n    method: [joint',
    'alike': 'markers: {2073: {frame: a.b}, 2096: {frame: a_b}}\n',
    'room': yaml_text(survey_content('map', [mapped('tray', np.ones(3))])),
    'objects': 'markers: {2073: {object: a.b}, 2096: {object: a-b}}\n',
}


# Libraries are loaded once for all nodes, each of which starts in a process of its own.
START = """
import os, sys
from importlib import import_module
for name in sys.argv[1:]:
    import_module(f'retrolidar_ros.nodes.{name}')
for line in sys.stdin:
    node, log, *arguments = line.split()
    if not (child := os.fork()):
        for stream in (1, 2):
            os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
        sys.argv = [node, '--ros-args', *arguments]
        with open(node) as program:
            exec(program.read())
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture(scope='module')
def refuse(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., list[str]]]:
    """Return a function that starts a node, and returns what it prints before it gives up."""
    directory = tmp_path_factory.mktemp('refused')
    for name, text in FILES.items():
        (directory / f'{name}.yaml').write_text(text)
    nodes = ('driver', 'detector', 'reader', 'coffee', 'heartbeat', 'landmarks', 'emulated_arm')
    command, pipe = [sys.executable, '-c', START, *nodes], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=directory) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        answers, count = process.stdout, itertools.count()

        def refuse(node: str, *arguments: str) -> list[str]:
            log = directory / f'{next(count)}.log'
            given = [one.replace('{}', str(directory)) for one in arguments]
            print(executable(node), log, *given, file=process.stdin, flush=True)
            code, lines = answers.readline(), log.read_text().splitlines()
            assert code == '2\n', lines
            assert not any('Traceback' in line for line in lines), lines
            return lines

        yield refuse
        process.stdin.close()


@pytest.mark.parametrize(
    ('node', 'arguments', 'message'),
    [
        ('driver', '--params-file {}/nowhere.yaml', 'nowhere.yaml'),
        ('driver', '-p serial_baud:=fast', "serial_baud: 'fast' is not of type int"),
        ('detector', '--params-file {}/broken.yaml', 'broken.yaml'),
        ('detector', '-p marker_file:={}/no.yaml', 'no.yaml cannot be read: No such file'),
        ('detector', '-p marker_file:={}/alike.yaml', 'would share the topic poses/a_b'),
        ('detector', '-p child_frame:=left', "child_frame: 'left' needs {name} once"),
        ('landmarks', '-p child_frame:=found', "child_frame: 'found' needs {name} once"),
        ('landmarks', "-p fixed_frame:=''", 'fixed_frame is empty; TF needs a name'),
        ('landmarks', '-p save_file:={}', 'is a directory; name a file in it'),
        ('landmarks', '-p save_file:={}/no/map.yaml', '/no; make it first'),
        ('landmarks', '-p localize:=true', 'localisation needs three: load_file has none'),
        ('landmarks', '-p localize:=true -p load_file:={}/room.yaml', 'not in marker_file: tray'),
        ('landmarks', '-p marker_file:={}/objects.yaml', 'a-b and a.b would share the topic'),
        ('landmarks', '-p load_file:=/dev/null', 'load_file: /dev/null: the file: needs keys'),
        ('coffee', '-p objects:=[a.b,a_b]', 'a.b and a_b would share the topic ~/objects/a_b'),
        ('coffee', '-p objects:=[a,a_to_b,b_to_c,c]', 'the topic ~/offsets/a_to_b_to_c'),
        ('coffee', '-p min_height:=2.0 -p max_height:=1.0', 'min_height is above max_height'),
        ('emulated_arm', '-p scene:=nowhere', 'scene: there is no scene nowhere'),
        ('heartbeat', '-p qos_overrides./markers.subscription.depth:=x', "to 'x' of type"),
        ('detector', '-p qos_overrides./frames.subscription.reliability:=best_eff', '`best_eff`'),
        ('heartbeat', '-p markers:=[]', 'markers: there is no name'),
        ('reader', '-p ports:=[/a,/b] -p names:=[x]', 'names: 1 of them for 2 ports'),
        ('reader', '-p ports:=[/a,/b] -p names:=[a.b,a_b]', 'a.b and a_b would share the topic'),
        ('reader', '-p ports:=[/a,/a]', 'ports: /a, /a are not all different'),
        ('reader', '-p frame_id:=/odom', "'/odom' begins with a slash, which tf2 refuses"),
    ],
)
def test_an_impossible_start_gives_one_clear_line(
    refuse: Callable[..., list[str]], node: str, arguments: str, message: str
) -> None:
    lines = refuse(node, *arguments.split())
    output = '\n'.join(lines)
    assert output.count(message) == 1, output
    assert len(output) < 2000
    # rcl and the middleware write lines of their own, as of a port that a killed process left.
    others = r'\[rcl\]: Failed to parse|\[INFO\]|RTPS_'
    written = [line for line in lines if not re.search(others, line)]
    assert len(written) == 1, output


PARAMETERS = """/**:
  ros__parameters: {robot_name: r2, method: paper, serial_prt: x}
/**/driver:
  ros__parameters:
    qos_overrides./ending/frames.publisher: {reliability: best_effort}
/**/landmarks:
  ros__parameters:
    patience: 2
    qos_overrides./ending/markers.subscription: {reliability: best_effort}
    qos_overrides./ending/landmarks/marker_array.publisher: {reliability: best_effort}
"""


def test_misspelled_parameters_are_warned_of_and_sigterm_ends_in_order(tmp_path: Path) -> None:
    """And parameters of other nodes are not; qualities of service are those of the file."""
    file = tmp_path / 'parameters.yaml'
    file.write_text(PARAMETERS)
    topics = {'driver': 'frames', 'landmarks': 'landmarks/marker_array'}
    with running(tmp_path, '/ending') as system:
        for node in topics:
            system.start(node, '--params-file', str(file))
        for node, topic in topics.items():
            system.next_status(f'{node}: {topic.partition("/")[0]}')
            (publisher,) = system.node.get_publishers_info_by_topic(f'/ending/{topic}')
            assert publisher.qos_profile.reliability.name == 'BEST_EFFORT'
        found = system.node.get_subscriptions_info_by_topic('/ending/markers')
        # The observer of this test is reliable.
        assert {one.qos_profile.reliability.name for one in found} == {'BEST_EFFORT', 'RELIABLE'}
        # What is written as an integer does for a number.
        assert system.services.get('/ending/landmarks')['patience'].double_value == 2.0
        for node, warnings in (('driver', 1), ('landmarks', 0)):
            system.stop(node, signal.SIGTERM)
            told = 'parameter serial_prt is unknown; did you mean serial_port?'
            assert system.log(node).count('is unknown') == warnings
            assert (told in system.log(node)) == bool(warnings)


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
    'command', ['detector --ros-args -p method:=magic', 'retrolidar decode nowhere']
)
def test_numpy_has_one_thread_from_its_import_on(command: str, tmp_path: Path) -> None:
    name, *arguments = command.split()
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
    # Before that, the middleware may have complained of what others left in shared memory.
    first, *_ = (line for line in result.stdout.splitlines() if line.startswith('threads'))
    assert first == 'threads: 1'


PROGRAM = """
import sys, time
from rclpy.node import Node
from retrolidar_ros.nodes.run import run

STAGE = sys.argv[1]

def reached(stage):
    if stage == STAGE:
        print('here', flush=True)
        time.sleep(0.3)

class Stuck(Node):
    def __init__(self):
        reached('creation')
        super().__init__('stuck')
        self.create_timer(0.01, self.tick)

    def tick(self):
        reached('callback')
        if STAGE == 'clean-up':
            print('here', flush=True)

    def destroy_node(self):
        print('destroyed', flush=True)
        super().destroy_node()

sys.exit(run(Stuck))
"""


@contextmanager
def stuck(stage: str, *prefix: str) -> Iterator[tuple['subprocess.Popen[bytes]', Iterator[bytes]]]:
    """Give a node that has got stuck, and its output; the block is to end it, in order."""
    command, pipe = [*prefix, sys.executable, '-c', PROGRAM, stage], subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, b'')
        assert b'here\n' in lines  # the middleware may print, too
        yield process, lines
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert output.count(b'destroyed') == 1
    assert b'Traceback' not in errors


@pytest.mark.parametrize(
    ('stage', 'number'),
    [
        ('creation', signal.SIGINT),
        ('creation', signal.SIGTERM),
        ('callback', signal.SIGTERM),
        ('callback', signal.SIGHUP),
        ('clean-up', signal.SIGINT),
    ],
)
def test_a_signal_ends_the_process_in_order(stage: str, number: signal.Signals) -> None:
    with stuck(stage) as (process, _):
        process.send_signal(number)
        process.send_signal(signal.SIGINT)  # `ros2 launch` passes on what all have got already


def test_a_node_that_nohup_started_outlives_its_session() -> None:
    with stuck('clean-up', 'nohup') as (process, lines):
        process.send_signal(signal.SIGHUP)
        assert [b'here\n' in lines for _ in range(100)] == [True] * 100  # of a second
        process.send_signal(signal.SIGTERM)
