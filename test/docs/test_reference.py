# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tables of docs/reference.md against the declarations of the code."""

import ast
import re
import runpy
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from documents import DOCS, ROOT, quoted, rows

from retrolidar_ros.detector.settings import PARAMETERS
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_yaml

REFERENCE = (DOCS / 'reference.md').read_text(encoding='utf-8')
LAUNCHING = 'retrolidar_ros.nodes.launching'
NODES = sorted((ROOT / 'retrolidar_ros' / 'nodes').glob('*.py'))


def calls(path: Path, *names: str) -> Iterator[ast.Call]:
    """Yield the calls of functions and methods of these names."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Call):
            function = node.func
            if getattr(function, 'attr', getattr(function, 'id', '')) in names:
                yield node


def written(default: object) -> str:
    """Return a parameter's default as the table has it."""
    if default == '':
        return 'empty'
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, list):
        return f'`[{", ".join(map(str, default))}]`'
    return f'`{default}`' if isinstance(default, str) else str(default)


def test_every_parameter_and_its_default() -> None:
    expected = [
        (f'`{node.removeprefix("/**/")}`', f'`{name}`', written(default))
        for node, section in load_yaml(shared_file('config/retrolidar.yaml')).items()
        for name, default in section['ros__parameters'].items()
    ]
    listed = [
        (node, name.strip('†'), default) for node, name, default, _ in rows(REFERENCE, 'node')
    ]
    assert sorted(listed) == sorted(expected)


def test_which_parameters_are_live() -> None:
    live = {
        (node, name.strip('†')) for node, name, *_ in rows(REFERENCE, 'node') if name.endswith('†')
    }
    assert live == {
        (f'`{path.stem.removesuffix("_parameters")}`', f'`{call.args[0].value!s}`')
        for path in NODES
        for call in calls(path, 'text', 'flag', 'integer', 'integers', 'number')
        if any(keyword.arg == 'live' for keyword in call.keywords)
        and isinstance(call.args[0], ast.Constant)
    } | {('`detector`', f'`{name}`') for name, one in PARAMETERS.items() if one.live}


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda path: path.stem)
def test_every_launch_argument(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    launch = MagicMock()
    # What the launch files share is imported anew, and forgotten.
    monkeypatch.setitem(sys.modules, LAUNCHING, launch)
    del sys.modules[LAUNCHING]
    for name in ('', '.actions', '.launch_context', '.substitutions'):
        monkeypatch.setitem(sys.modules, f'launch{name}', launch)
        monkeypatch.setitem(sys.modules, f'launch_ros{name}', MagicMock())
    runpy.run_path(str(path))['generate_launch_description']()
    # A row is of all launch files, of all but those that it names, or of those that it names.
    declared = [call.args[0] for call in launch.DeclareLaunchArgument.call_args_list]
    assert declared
    assert sorted(declared) == sorted(
        name
        for cells in rows(REFERENCE, 'launch file')
        if cells[0].startswith('all') != (path.name in quoted(cells[0]))
        for name in quoted(cells[1])
    )


def test_every_topic() -> None:
    published = set()
    for path in NODES:
        for call in calls(path, 'create_publisher', 'publisher'):
            name = call.args[2 if ast.unparse(call.func) == 'publisher' else 1]
            first = name.values[0] if isinstance(name, ast.JoinedStr) else name
            if isinstance(first, ast.Constant):
                published.add(str(first.value).strip('~/'))
    topics = {quoted(cells[0])[0] for cells in rows(REFERENCE, 'topic')}
    unknown = [one for one in published if not any(f'/{one}/' in f'{topic}/' for topic in topics)]
    assert not unknown
    for topic in topics - {'/tf'}:
        assert any(f'/{one}/' in f'{topic}/' for one in published), topic


def test_every_diagnostic_value() -> None:
    said = {value.strip() for cells in rows(REFERENCE, 'status') for value in cells[1].split(',')}
    sources = [path.read_text(encoding='utf-8') for path in NODES]
    keys = {
        re.sub(r' \[.*\]', '', key.value)
        for source in sources
        if 'Health(' in source
        for node in ast.walk(ast.parse(source))
        for key in (node.keys if isinstance(node, ast.Dict) else [])
        if isinstance(key, ast.Constant) and isinstance(key.value, str)
    }
    assert (
        {'lost frames', 'candidates'} <= keys <= said | {'frames of another sensor'}
    )  # counted, not reported
