# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import ast
import sys
from pathlib import Path

import pytest

import retrolidar_ros

PACKAGE = Path(retrolidar_ros.__file__).parent
CORE = [
    'core.py',
    'code.py',
    'frame.py',
    'frame_rate.py',
    'wire.py',
    'st_example.py',
    'clock.py',
    'liquid_crystal.py',
    'dictionary.py',
    'markers.py',
    'objects.py',
    'heartbeat.py',
    'rotation.py',
    'section.py',
    'wakeup.py',
    'battery.py',
    'blinking.py',
    'detector',
    'scene',
]
ROS = {'rclpy', 'tf2_ros', 'tf2_msgs', 'ament_index_python'}


def modules(name: str) -> list[Path]:
    path = PACKAGE / name
    return sorted(path.rglob('*.py')) if path.is_dir() else [path]


def imports(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            found.add(node.module or '')
    return found


@pytest.mark.parametrize('name', CORE)
def test_the_core_needs_numpy_and_the_standard_library_only(name: str) -> None:
    core = {f'retrolidar_ros.{Path(part).stem}' for part in CORE} | {'retrolidar_ros._core'}
    for path in modules(name):
        for module in imports(path):
            package = module.split('.')[0]
            if package == 'retrolidar_ros':
                assert '.'.join(module.split('.')[:2]) in core, f'{path} imports {module}'
            else:
                assert package == 'numpy' or package in sys.stdlib_module_names, (
                    f'{path} imports {module}'
                )


def test_only_nodes_import_ros_when_they_are_imported() -> None:
    for path in PACKAGE.rglob('*.py'):
        if 'nodes' in path.relative_to(PACKAGE).parts or 'msg' in path.parts:
            continue
        for statement in ast.parse(path.read_text()).body:
            if isinstance(statement, ast.Import | ast.ImportFrom):
                names = [a.name for a in statement.names]
                module = getattr(statement, 'module', None) or names[0]
                assert module.split('.')[0] not in ROS, f'{path} imports {module}'
                assert not module.split('.')[0].endswith('_msgs'), f'{path} imports {module}'
