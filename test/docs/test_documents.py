# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All documents against the commands, messages, parameters, packets and pins that they name."""

import argparse
import ast
import re
import runpy
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from unittest.mock import MagicMock

import pytest

from retrolidar_ros.cli import main as cli
from retrolidar_ros.detector.detection import Reason
from retrolidar_ros.marker.code import packet
from retrolidar_ros.sensor import wire
from retrolidar_ros.settings.files import load_yaml, shared_file

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGES = [ROOT / 'README.md', *sorted(DOCS.rglob('*.md'))]


def quoted(text: str) -> list[str]:
    """Return what stands in backticks."""
    return re.findall(r'`([^`]+)`', text)


def without_blocks(page: Path) -> str:
    """Return a page without its indented blocks."""
    lines = page.read_text(encoding='utf-8').splitlines()
    return '\n'.join(line for line in lines if not line.startswith('    '))


def rows(text: str, header: str) -> Iterator[list[str]]:
    """Yield the rows of all tables whose first column has this header.

    An empty first cell is that of the row before.
    """
    for table in re.findall(rf'^\| {re.escape(header)} \|.*\n\|[-|]+\n((?:\|.*\n?)+)', text, re.M):
        first = ''
        for line in table.splitlines():
            cells = [cell.strip() for cell in line.strip('|').split('|')]
            first = cells[0] = cells[0] or first
            yield cells


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def text_of(name: str) -> str:
    return (DOCS / name).read_text(encoding='utf-8')


# Links and commands


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub makes of a page's headings."""
    headings = re.findall(r'^#+ (.+)', page.read_text(encoding='utf-8'), re.M)
    return {re.sub(r'[^\w\- ]', '', one.lower()).replace(' ', '-') for one in headings}


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_every_link_leads_somewhere(page: Path) -> None:
    for target in re.findall(r'\]\(([^)\s]+)\)', without_blocks(page)):
        if re.match(r'\w+:', target):
            continue
        file, _, anchor = target.partition('#')
        place = (page.parent / file).resolve() if file else page
        assert place.exists(), target
        assert not anchor or anchor in anchors(place), target


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_every_command_and_option_exists(page: Path) -> None:
    parser = cli.parser()
    (group,) = (one for one in parser._actions if isinstance(one, argparse._SubParsersAction))
    blocks = re.findall(r'^    (.+)', page.read_text(encoding='utf-8'), re.M)
    for text in [*blocks, *quoted(without_blocks(page))]:
        for shown in re.findall(r'(?:^|embedded/run |\| )retrolidar ([a-z].*)', text):
            command, *words = shown.split('#')[0].split()
            options = group.choices[command]._option_string_actions
            assert not {word for word in words if word.startswith('--')} - {*options}, shown


# Messages


@cache
def messages() -> str:
    """Return the texts of the code, a line each, with … for what is filled in."""
    sources = [*(ROOT / 'retrolidar_ros').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]
    nodes = [node for one in sources for node in ast.walk(ast.parse(one.read_text('utf-8')))]
    filled = [node.values for node in nodes if isinstance(node, ast.JoinedStr)]
    whole = [[node] for node in nodes if isinstance(node, ast.Constant)]
    return '\n'.join(
        ''.join(str(part.value) if isinstance(part, ast.Constant) else '…' for part in parts)
        for parts in filled + whole
    )


@pytest.mark.parametrize(
    ('page', 'header', 'column'),
    [('reference.md', 'what is wrong', 1), ('troubleshooting.md', 'what it says', 0)],
)
def test_every_message_is_one_of_the_code(page: str, header: str, column: int) -> None:
    said = [text for cells in rows(text_of(page), header) for text in quoted(cells[column])]
    assert said
    for text in said:
        if not text.startswith("Couldn't parse"):  # said by rcl
            parts = [re.escape(part.strip()) for part in text.split('…')]
            assert re.search('.*'.join(parts), messages()), text


# Reasons


def test_the_table_of_reasons_is_complete() -> None:
    reasons = [f'`{reason.value}`' for reason in Reason]
    source = ROOT / 'retrolidar_ros' / 'detector' / 'paper_detector.py'
    found = re.findall(r"rejected\['([^']+)'\]", source.read_text(encoding='utf-8'))
    paper = {f'`{reason}`' for reason in found}
    listed = [cells[0] for cells in rows(text_of('troubleshooting.md'), '`rejected: …`')]
    assert len(listed) == len(set(listed))
    assert set(listed) == {*reasons, *paper}


# What the firmware's builders rely on


def test_packets_for_firmware() -> None:
    table = list(rows(text_of('hardware.md'), 'ID'))
    assert table
    for marker_id, bits in table:
        assert bits.replace(' ', '') == ''.join(map(str, packet(int(marker_id))))


def test_bytes_of_a_frame() -> None:
    table = [cells for cells in rows(text_of('reference.md'), 'zones') if cells[1].isdigit()]
    assert table
    for shape, size, *_ in table:
        rows_, columns = map(int, shape.split('×'))
        zones = rows_ * columns * wire._ZONE.itemsize
        assert len(wire.encode_packet(b'\x01' * (wire._HEADER.size + zones))) == int(size)


def test_the_pins_of_the_wiring_table_are_those_of_the_sketch() -> None:
    wired = re.findall(r'^\| (\w+) \| `(\w+_PIN)` \|', text_of('hardware.md'), re.M)
    sketch = (ROOT / 'firmware' / 'reader' / 'reader.ino').read_text('utf-8')
    constants = re.findall(r'(\w+_PIN) = (\w+)', sketch)
    assert sorted((name, pin) for pin, name in wired) == sorted(constants)


def test_every_key_of_scenes_is_listed() -> None:
    def keys(content: object) -> set[str]:
        if isinstance(content, list):
            return set().union(*map(keys, content))
        return (
            set(content).union(*map(keys, content.values())) if isinstance(content, dict) else set()
        )

    section = text_of('reference.md').partition('## Scenes')[2].partition('\n## ')[0]
    listed = {one.removesuffix('[]') for one in quoted(section)}
    assert keys(load_yaml(ROOT / 'test' / 'scene' / 'every_key.yaml')) <= listed


# The reference against the declarations of the code

REFERENCE = text_of('reference.md')
LAUNCHING = 'retrolidar_ros.nodes.launching'
SOURCES = sorted((ROOT / 'retrolidar_ros' / 'nodes').glob('*.py'))


def calls(path: Path, *names: str) -> Iterator[ast.Call]:
    """Yield the calls of functions and methods of these names."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Call):
            function = node.func
            if getattr(function, 'attr', getattr(function, 'id', '')) in names:
                yield node


@pytest.mark.parametrize('path', sorted((ROOT / 'launch').glob('*.py')), ids=lambda path: path.stem)
def test_every_launch_argument(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    launch = MagicMock()
    # What the launch files share is imported anew, and forgotten.
    monkeypatch.setitem(sys.modules, LAUNCHING, launch)
    del sys.modules[LAUNCHING]
    modules = ('', '.actions', '.events', '.events.process', '.launch_context', '.substitutions')
    for name in (*modules, '.launch_description_entity', '.logging'):
        monkeypatch.setitem(sys.modules, f'launch{name}', launch)
        monkeypatch.setitem(sys.modules, f'launch_ros{name}', MagicMock())
    runpy.run_path(str(path))['generate_launch_description']()
    arguments = launch.DeclareLaunchArgument.call_args_list
    declared = {one.args[0]: one.kwargs['default_value'] for one in arguments}
    assert declared
    # A row is of all launch files, of all but those that it names, or of those that it names.
    documented = {
        name: cells[2].replace('`', '')
        for cells in rows(REFERENCE, 'launch file')
        if cells[0].startswith('all') != (path.name in quoted(cells[0]))
        for name in quoted(cells[1])
    }
    assert sorted(declared) == sorted(documented)
    for name, default in declared.items():
        texts = documented[name].split(', ')
        default = default.removeprefix(f'{shared_file("package.xml").parent}/')
        # A default that depends on the launch file names it.
        if ':' not in documented[name]:
            assert (default or 'none') in texts or texts == [default], name


def test_every_topic() -> None:
    published = set()
    for path in SOURCES:
        for call in calls(path, 'create_publisher', 'publisher', 'latched'):
            name = call.args[2 if ast.unparse(call.func) in ('publisher', 'latched') else 1]
            first = name.values[0] if isinstance(name, ast.JoinedStr) else name
            if isinstance(first, ast.Constant):
                published.add(str(first.value).strip('~/'))
        for call in calls(path, 'topics_of'):
            if isinstance(call.args[0], ast.Constant):  # not the namespaces of a reader
                published.add(str(call.args[0].value).strip('~/'))
    topics = {quoted(cells[0])[0] for cells in rows(REFERENCE, 'topic')}
    unknown = [one for one in published if not any(f'/{one}/' in f'{topic}/' for topic in topics)]
    assert not unknown
    for topic in topics - {'/tf'}:
        assert any(f'/{one}/' in f'{topic}/' for one in published), topic


def test_every_diagnostic_value() -> None:
    said = {value.strip() for cells in rows(REFERENCE, 'status') for value in cells[1].split(',')}
    sources = [path.read_text(encoding='utf-8') for path in SOURCES]
    keys = {
        re.sub(r' \[.*\]', '', key.value)
        for source in sources
        if 'Health(' in source
        for node in ast.walk(ast.parse(source))
        for key in (node.keys if isinstance(node, ast.Dict) else [])
        if isinstance(key, ast.Constant) and isinstance(key.value, str)
    }
    assert {'lost frames', 'candidates'} <= keys <= said
