# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import ast
import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PRODUCT = ROOT / 'retrolidar_ros'
# A room imports from those below it and from its own floor.
FLOORS = (
    {'cli', 'nodes'},
    {'tasks'},
    {'scene', 'bag'},
    {'detector'},
    {'sensor', 'marker'},
    {'settings'},
)
LOOSE = {'__init__.py', 'core.py', '_core.pyi'}
BINDING = {'core', '_core'}  # to the library in C
ALLOWED = {
    'settings': {'yaml'},
    'sensor': {'numpy', 'serial'},
    'bag': {'numpy', 'rosbags', 'yaml'},
    'cli': {'numpy', 'yaml', 'serial', 'matplotlib'},
}
ROS = {'rclpy', 'tf2_ros', 'tf2_msgs', 'ament_index_python'}
WITH_ROS = {'cli', 'nodes'}


def imports(room: str) -> Iterator[tuple[Path, str]]:
    """Yield each file of a room with each module that it imports."""
    for path in (PRODUCT / room).rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from ((path, alias.name) for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                assert node.level == 0, f'{path}: a relative import'
                yield path, node.module or ''
                if node.module == 'retrolidar_ros':
                    yield from ((path, f'retrolidar_ros.{alias.name}') for alias in node.names)


def test_every_file_is_in_a_room() -> None:
    rooms = {path.name for path in PRODUCT.iterdir() if path.is_dir()} - {'__pycache__'}
    assert rooms == set().union(*FLOORS)
    loose = {path.name for path in PRODUCT.iterdir() if path.is_file()}
    assert {name for name in loose if not name.endswith('.so')} == LOOSE


@pytest.mark.parametrize(
    'floor', range(len(FLOORS)), ids=lambda index: '+'.join(sorted(FLOORS[index]))
)
def test_imports_go_down(floor: int) -> None:
    below = set().union(*FLOORS[floor:]) | BINDING
    if 'nodes' in FLOORS[floor]:
        below.add('msg')
    for path, module in chain.from_iterable(map(imports, FLOORS[floor])):
        package, *rest = module.split('.')
        assert package not in {'evaluation', 'benchmarks'}, f'{path} imports {module}'
        if package == 'retrolidar_ros' and rest:
            assert rest[0] in below, f'{path} imports {module}'


@pytest.mark.parametrize('room', sorted(set().union(*FLOORS) - WITH_ROS))
def test_rooms_need_no_ros_and_few_libraries(room: str) -> None:
    allowed = ALLOWED.get(room, {'numpy'}) | {'retrolidar_ros'} | set(sys.stdlib_module_names)
    for path, module in imports(room):
        assert module.split('.')[0] in allowed, f'{path} imports {module}'


def test_the_command_needs_ros_for_demos_and_replay_only() -> None:
    for path, module in imports('cli'):
        package, is_node = module.split('.')[0], module.startswith('retrolidar_ros.nodes')
        if package in ROS or package.endswith('_msgs') or is_node:
            assert path.name in ('demo.py', 'demo_arm.py', 'replay.py'), f'{path} imports {module}'
