# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Coffee, drone and two sensors, started one by one: what test/launch asserts of launch files."""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from harness import Sensor
from harness_use_cases import (
    BASE_VIEW,
    SENSOR_VIEW,
    SIDES,
    Collected,
    Health,
    check_coffee,
    check_heartbeat,
    check_two_sensors,
    impatient_parameters,
    publish_base,
    silent_drone,
    wait,
)
from std_msgs.msg import Bool, String

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file

MARKER_FILE = f'marker_file:={shared_file("config/markers.yaml")}'


class Nodes:
    """Nodes that a test starts, and a listener; all are to run until the test has succeeded."""

    def __init__(self, directory: Path, namespace: str) -> None:
        self.directory = directory
        self.namespace = namespace
        self.parameters = shared_file('config/retrolidar.yaml')
        self.processes = ProcessGroup(directory)
        self.listener = Listener(namespace)
        self._names: list[str] = []
        self._stack = ExitStack()
        self._stack.callback(self.listener.close)

    def __enter__(self) -> 'Nodes':
        self._stack.enter_context(self.processes)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with self._stack:
            if error is None:
                self.processes.check()
                codes = {name: self.processes.stop(name) for name in self._names}
                assert codes == dict.fromkeys(self._names, 0)
                for name in self._names:
                    assert 'Traceback' not in self.log(name)

    def port(self, name: str = 'port') -> Path:
        return self.directory / name

    def log(self, name: str) -> str:
        return self.processes.log(name).read_text()

    def start(self, node: str, *arguments: str, below: str = '') -> None:
        """Start a node in the namespace, or in one below it."""
        name = f'{below}_{node}' if below else node
        namespace = f'{self.namespace}/{below}'.rstrip('/')
        common = ['--params-file', str(self.parameters), '-r', f'__ns:={namespace}']
        self.processes.start(name, [executable(node), '--ros-args', *common, *arguments])
        self._names.append(name)

    def start_sensor(self) -> None:
        """Start driver and detector of one sensor."""
        self.start('driver', '-p', f'serial_port:={self.port()}')
        self.start('detector', '-p', MARKER_FILE)

    def wait_for(self, topic: str, subscribers: int) -> None:
        """Wait until somebody publishes a topic and so many hear it, the listener included."""
        node = self.listener.node

        def is_heard() -> bool:
            self.processes.check()
            return node.count_publishers(topic) > 0 and node.count_subscribers(topic) >= subscribers

        wait(self.listener, is_heard, lambda: f'{subscribers} who hear {topic}')


def test_a_drone_that_falls_silent_is_overdue(tmp_path: Path) -> None:
    scene = load_scene(str(silent_drone(tmp_path, start_s=0.2, packets=2)))
    with Nodes(tmp_path, '/use_drone') as nodes:
        nodes.parameters = impatient_parameters(tmp_path)
        alive = Collected(nodes.listener, Bool, 'heartbeat/alive')
        health = Health(nodes.listener, f'{nodes.namespace}/heartbeat: markers')
        nodes.start_sensor()
        nodes.start('heartbeat')
        nodes.wait_for('frames', 2)
        nodes.wait_for('markers', 2)
        # Who was never there is overdue as well.
        wait(
            nodes.listener,
            lambda: 'drone is overdue' in nodes.log('heartbeat'),
            lambda: 'a first silence',
        )
        with Sensor(scene, nodes.port()):
            check_heartbeat(nodes.listener, alive, health, scene)
        log = nodes.log('heartbeat')
        assert log.count('drone is overdue: not read for ') == 2
        assert log.count('drone is back') == 1


def test_two_sensors_tell_of_the_same_markers_on_one_topic(tmp_path: Path) -> None:
    scene = load_scene('coffee')
    with Nodes(tmp_path, '/use_two') as nodes:
        for side in SIDES:
            frame = f'frame_id:={side}_optical_frame'
            nodes.start('driver', '-p', f'serial_port:={nodes.port(side)}', '-p', frame, below=side)
            child, topic = f'child_frame:={side}_{{name}}', f'markers:={nodes.namespace}/markers'
            nodes.start('detector', '-p', MARKER_FILE, '-p', child, '-r', topic, below=side)
        for side in SIDES:
            nodes.wait_for(f'{side}/frames', 1)
        wait(
            nodes.listener,
            lambda: nodes.listener.node.count_publishers('markers') == 2,
            lambda: 'both detectors',
        )
        with Sensor(scene, nodes.port('left')), Sensor(scene, nodes.port('right')):
            check_two_sensors(nodes.listener, scene, nodes.namespace)


@pytest.fixture(scope='module')
def coffee(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Nodes]:
    """Start two who wait for the same objects, of which one wants them in another frame."""
    scene = load_scene('coffee')
    with Nodes(tmp_path_factory.mktemp('coffee'), '/use_coffee') as nodes:
        publish_base(nodes.listener)
        nodes.start_sensor()
        enough = ('-p', 'max_stddev:=0.2')
        nodes.start('coffee', *enough)
        topic = f'markers:={nodes.namespace}/markers'
        frame = f'target_frame:={BASE_VIEW.frame}'
        nodes.start('coffee', *enough, '-p', frame, '-r', topic, below='base')
        nodes.wait_for('frames', 2)
        nodes.wait_for('markers', 3)
        ready = [Collected(nodes.listener, Bool, f'{it}coffee/ready') for it in ('', 'base/')]
        missing = [Collected(nodes.listener, String, f'{it}coffee/missing') for it in ('', 'base/')]
        wait(
            nodes.listener,
            lambda: all(one.messages for one in ready + missing),
            lambda: 'what is missing at first',
        )
        nothing_seen = ', '.join(f'{one.name} has not been seen' for one in scene.markers)
        assert [one.data() for one in ready] == [[False], [False]]
        assert [one.data() for one in missing] == [[nothing_seen], [nothing_seen]]
        with Sensor(scene, nodes.port()):
            yield nodes


def test_coffee_is_ready_when_all_objects_are_placed(coffee: Nodes) -> None:
    check_coffee(coffee.listener, load_scene('coffee'), '/use_coffee', SENSOR_VIEW)
    assert ': all objects are placed' in coffee.log('coffee')


def test_coffee_places_objects_in_the_target_frame(coffee: Nodes) -> None:
    check_coffee(coffee.listener, load_scene('coffee'), '/use_coffee/base', BASE_VIEW)
