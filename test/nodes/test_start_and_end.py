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
from pathlib import Path

import pytest
from harness_nodes import running

from retrolidar_ros.cli.demo import executable

FILES = {
    'broken': '/**:\n  ros__parameters:\n    method: [joint',
    'alike': 'markers: {2073: {frame: a.b}, 2096: {frame: a_b}}\n',
    'objects': 'markers: {2073: {object: a.b}, 2096: {object: a-b}}\n',
}


# Libraries are loaded once for all nodes, each of which starts in a process of its own.
START = """
import os, sys
from importlib import import_module
mains = {name: import_module(f'retrolidar_ros.nodes.{name}').main for name in sys.argv[1:]}
for line in sys.stdin:
    node, log, *arguments = line.split()
    if not (child := os.fork()):
        for stream in (1, 2):
            os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND), stream)
        sys.argv = [node, '--ros-args', *arguments]
        sys.exit(mains[node]())
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
            print(node, log, *given, file=process.stdin, flush=True)
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
        ('driver', '-p serial_baud:=fast', "'serial_baud' to 'fast' of type 'STRING'"),
        ('detector', '--params-file {}/broken.yaml', 'broken.yaml'),
        ('detector', '-p marker_file:={}/nowhere.yaml', 'marker_file: [Errno 2] No such file'),
        (
            'detector',
            '-p marker_file:={}/alike.yaml',
            'would share the topic poses/a_b',
        ),
        ('detector', '-p child_frame:=left', "child_frame: 'left' needs {name} once"),
        ('landmarks', "-p fixed_frame:=''", 'fixed_frame is empty; TF needs a name'),
        ('landmarks', '-p localize:=true', '0 markers are at known places; localisation needs'),
        ('landmarks', '-p marker_file:={}/objects.yaml', 'a-b and a.b would share the topic'),
        ('landmarks', '-p load_file:=/dev/null', 'load_file: /dev/null'),
        ('coffee', '-p objects:=[a.b,a_b]', 'a.b and a_b would share the topic ~/objects/a_b'),
        (
            'coffee',
            '-p objects:=[a,a_to_b,b_to_c,c]',
            'the topic ~/offsets/a_to_b_to_c',
        ),
        ('coffee', '-p min_height:=2.0 -p max_height:=1.0', 'min_height is above max_height'),
        ('emulated_arm', '-p scene:=nowhere', 'scene: there is no scene nowhere'),
        ('heartbeat', '-p markers:=[]', 'markers: there is no name'),
        ('reader', '-p ports:=[/a,/b] -p names:=[x]', 'names: 1 of them for 2 ports'),
        ('reader', '-p ports:=[/a,/a]', 'ports: one stands there twice'),
        ('reader', '-p frame_id:=/odom', "'/odom' begins with a slash, which tf2 refuses"),
    ],
)
def test_what_cannot_be_is_one_clear_line(
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


WARNED: dict[str, tuple[str, str, tuple[str, ...]]] = {
    'own': ('detector', '/**:\n  ros__parameters: {use_sim_time: false, robot_name: r2}', ()),
    'quality': (
        'driver',
        """/**:
  ros__parameters: {robot_name: r2, method: paper, serial_prt: x}
/**/driver:
  ros__parameters:
    robot_size: 2
    qos_overrides./quality/frames.publisher: {reliability: best_effort, depht: 3}
    qos_overrides./nowhere.depth: 3
""",
        (
            'robot_size',
            'serial_prt is unknown; did you mean',
            'publisher.depht is unknown; did you mean qos_overrides./quality/frames.publisher.d',
            'qos_overrides./nowhere.depth is unknown',
        ),
    ),
    'shapes': (
        'landmarks',
        """/**/landmarks:
  ros__parameters:
    qos_overrides./shapes/markers.subscription: {reliability: best_effort}
    qos_overrides./shapes/landmarks/marker_array.publisher: {reliability: best_effort}
""",
        (),
    ),
}
"""By namespace: a node, its parameters, and what it is to warn of."""
PUBLISHED = {
    'driver': ('frames', 'frames'),
    'detector': ('markers', 'markers'),
    'landmarks': ('landmarks', 'landmarks/marker_array'),
}
"""The subject of each node's diagnostics, and a topic."""


def test_unknown_parameters_are_warned_of_and_sigterm_ends_in_order(tmp_path: Path) -> None:
    """Where they are for all nodes, without false warnings; qualities of service are known."""
    with running(tmp_path, '/ending') as system:
        for namespace, (node, text, _) in WARNED.items():
            file = tmp_path / f'{namespace}.yaml'
            file.write_text(text)
            given = ('--params-file', str(file))
            system.start(node, *given, name=namespace, namespace=f'/{namespace}')
        for namespace, (node, _, _) in WARNED.items():
            subject, topic = PUBLISHED[node]
            system.next_status(f'/{namespace}/{node}: {subject}')
            (publisher,) = system.node.get_publishers_info_by_topic(f'/{namespace}/{topic}')
            expected = 'BEST_EFFORT' if 'qos_overrides' in WARNED[namespace][1] else 'RELIABLE'
            assert publisher.qos_profile.reliability.name == expected
        (subscriber,) = system.node.get_subscriptions_info_by_topic('/shapes/markers')
        assert subscriber.qos_profile.reliability.name == 'BEST_EFFORT'
        for namespace, (_, _, warnings) in WARNED.items():
            system.stop(namespace, signal.SIGTERM)
            unknown = [x for x in system.log(namespace).splitlines() if 'is unknown' in x]
            assert len(unknown) == len(warnings), unknown
            for warning in warnings:
                assert any(warning in line for line in unknown), unknown


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
