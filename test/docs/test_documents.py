# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All documents against the commands, messages, reasons, packets and pins that they name."""

import argparse
import ast
import re
from functools import cache
from pathlib import Path

import pytest
from documents import DOCS, PAGES, ROOT, quoted, rows, without_blocks

from retrolidar_ros.cli import main as cli
from retrolidar_ros.detector.reason import Reason
from retrolidar_ros.marker.code import packet
from retrolidar_ros.sensor import wire


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


def test_the_tables_of_reasons_are_complete() -> None:
    reasons = [f'`{reason.value}`' for reason in Reason]
    assert [cells[0] for cells in rows(text_of('detector.md'), 'reason')] == reasons
    sources = (ROOT / 'retrolidar_ros' / 'detector' / 'paper').glob('*.py')
    paper = {
        f'`{reason}`'
        for source in sources
        for reason in re.findall(r"rejected\['([^']+)'\]", source.read_text(encoding='utf-8'))
    }
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


def test_the_pins_of_the_wiring_tables_are_those_of_the_sketches() -> None:
    wired = re.findall(r'^\| (\w+) \| `(\w+_PIN)` \|', text_of('hardware.md'), re.M)
    sketches = '\n'.join(path.read_text('utf-8') for path in (ROOT / 'firmware').glob('*/*.ino'))
    constants = re.findall(r'(\w+_PIN) = (\w+)', sketches)
    assert sorted((name, pin) for pin, name in wired) == sorted(constants)
