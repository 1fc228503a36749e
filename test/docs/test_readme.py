# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The README's tables against what they tell of."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from retrolidar_ros.settings.resources import shared_file

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')
NODES = ROOT / 'retrolidar_ros' / 'nodes'


def rows(header: str) -> Iterator[list[str]]:
    """Yield the rows of the table whose first line begins so; an empty first cell is repeated."""
    lines = iter(README.splitlines())
    for line in lines:
        if line.startswith(header):
            break
    first = ''
    for line in lines:
        if not line.startswith('|'):
            return
        cells = [cell.strip() for cell in line.strip('|').split('|')]
        if set(cells[0]) <= set('-'):
            if cells[0]:
                continue
            cells[0] = first
        first = cells[0]
        yield cells


def quoted(text: str) -> list[str]:
    return re.findall(r'`([^`]+)`', text)


def calls(path: Path, *names: str) -> Iterator[ast.Call]:
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            if name in names:
                yield node


def written(value: Any) -> str:
    if value == '':
        return 'empty'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f'`[{", ".join(map(str, value))}]`'
    return f'`{value}`' if isinstance(value, str) else str(value)


def test_every_parameter_and_its_default() -> None:
    content = yaml.safe_load(shared_file('config/retrolidar.yaml').read_text(encoding='utf-8'))
    expected = [
        (f'`{node.removeprefix("/**/")}`', f'`{name}`', written(default))
        for node, section in content.items()
        for name, default in section['ros__parameters'].items()
    ]
    found = [(cells[0], cells[1], cells[2]) for cells in rows('| node | parameter')]
    assert sorted(found) == sorted(expected)


def test_which_parameters_are_live() -> None:
    live = {
        (cells[0].strip('`'), cells[1].strip('`'))
        for cells in rows('| node | parameter')
        if cells[3] == 'live'
    }
    declared = {
        (path.stem, call.args[0].value)
        for path in NODES.glob('*.py')
        for call in calls(path, 'text', 'flag', 'integer', 'integers', 'number')
        if any(keyword.arg == 'live' for keyword in call.keywords)
        and isinstance(call.args[0], ast.Constant)
    }
    assert live == declared


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda path: path.stem)
def test_every_launch_argument(path: Path) -> None:
    told = [
        name
        for cells in rows('| launch file')
        if cells[0] == f'`{path.name}`'
        for name in quoted(cells[2])
    ]
    source = path.read_text(encoding='utf-8')
    keys = re.findall(r"^        '(\w+)': \(", source, flags=re.MULTILINE)
    for ending in re.findall(r"arguments\[f'\{side\}(\w+)'\]", source):
        keys += [f'{side}{ending}' for side in ('left', 'right')]
    assert keys
    assert sorted(told) == sorted(keys)


def test_every_topic() -> None:
    told = {quoted(cells[0])[0].rpartition('/')[2] for cells in rows('| topic')}
    published = set()
    for path in NODES.glob('*.py'):
        for call in calls(path, 'create_publisher'):
            topic = call.args[1]
            if isinstance(topic, ast.JoinedStr):
                topic = topic.values[0]
            if isinstance(topic, ast.Constant):
                published.add(str(topic.value).strip('~/').rpartition('/')[2] or str(topic.value))
    # Of these the README names the topics that are below them.
    assert told == published - {'objects', 'offsets'} | {'<name>', '<a>_to_<b>'}


def test_every_diagnostic_value() -> None:
    told = ' '.join(cells[1] for cells in rows('| status'))
    words = set(re.findall(r'\w+', told))
    for name in ('driver', 'detector'):
        for node in ast.walk(ast.parse((NODES / f'{name}.py').read_text(encoding='utf-8'))):
            if not isinstance(node, ast.Dict) or not node.keys:
                continue
            keys = [key.value for key in node.keys if isinstance(key, ast.Constant)]
            for key in map(str, keys):
                plain = re.sub(r'\[.*\]', '', key).replace('when processed', '')
                for word in re.findall(r'\w+', plain):
                    assert {word, word.removesuffix('s')} & words, f'{name}: {key}'


def test_every_path_and_link_leads_somewhere() -> None:
    for target in re.findall(r'\]\(([^)#]+)\)', README):
        assert (ROOT / target).exists(), target
