# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The documents against what they quote: code, commands and links."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
import yaml

from evaluation.experiments.registry import EXPERIMENTS
from retrolidar_ros.cli import main as cli
from retrolidar_ros.detector import METHODS
from retrolidar_ros.detector.reason import Reason
from retrolidar_ros.marker.code import PREAMBLE, packet
from retrolidar_ros.marker.dictionary import choose_ids
from retrolidar_ros.sensor import wire

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGES = [ROOT / 'README.md', *sorted(DOCS.rglob('*.md'))]
GUIDES = [DOCS / f'{name}.md' for name in ('hardware', 'choosing', 'troubleshooting')]
# What the guides name that is not ours.
FOREIGN = {
    'map',
    'base_link',
    '--clock',
    '--once',
    'OPENBLAS_NUM_THREADS=1',
    'id',
    'header.stamp',
    ',upload_method=OpenOCDSTLink',
}
PROGRAMS = ('ros2 ', 'ls ', 'make ', 'python3 ', 'xxd ', 'retrolidar ', 'stty ')


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def lines_of(path: Path) -> list[str]:
    return path.read_text(encoding='utf-8').splitlines()


def spans(path: Path) -> list[str]:
    """Return what stands in backticks, the indented blocks left out."""
    text = '\n'.join(line for line in lines_of(path) if not line.startswith('    '))
    return re.findall(r'`([^`]+)`', text)


def is_path(text: str) -> bool:
    return '/' in text and (ROOT / text).exists()


# What is quoted from the code


def templates(path: Path) -> Iterator[list[str]]:
    """Yield the texts of a source, docstrings left out, in pieces between what is filled in."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    skipped = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(node.value)
        if isinstance(node, ast.JoinedStr):
            skipped |= {part for part in node.values if isinstance(part, ast.Constant)}
            pieces = ['']
            for part in node.values:
                if isinstance(part, ast.Constant):
                    pieces[-1] += str(part.value)
                else:
                    pieces.append('')
            yield pieces
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in skipped:
            yield [node.value]


@cache
def code_texts() -> tuple[list[str], ...]:
    sources = [*(ROOT / 'retrolidar_ros').rglob('*.py'), *(ROOT / 'launch').glob('*.py')]
    return tuple(pieces for source in sources for pieces in templates(source))


def is_said(quoted: str) -> bool:
    """Tell whether a text with … for what is left out is part of one of the code's."""
    parts = [part.strip() for part in quoted.split('…') if part.strip()]
    quote = '.*'.join(map(re.escape, parts))
    for pieces in code_texts():
        if re.search(rf'(?<!\w){quote}(?!\w)', '\0'.join(pieces), flags=re.DOTALL):
            return True
        known = '.+'.join(map(re.escape, pieces))
        if len(''.join(pieces).strip()) > 5 and re.fullmatch(known, quoted):
            return True
    return False


@cache
def names() -> frozenset[str]:
    """Return parameters, launch arguments, message fields, methods and experiments."""
    config = yaml.safe_load((ROOT / 'config' / 'retrolidar.yaml').read_text(encoding='utf-8'))
    found = {*METHODS, *EXPERIMENTS}
    for node, section in config.items():
        found |= {node.removeprefix('/**/'), *section['ros__parameters']}
    for launch_file in (ROOT / 'launch').glob('*.py'):
        source = launch_file.read_text(encoding='utf-8')
        found |= {
            launch_file.name,
            *re.findall(r"^        '(\w+)': \(", source, flags=re.MULTILINE),
        }
    for message in (ROOT / 'msg').glob('*.msg'):
        found |= set(re.findall(r'^\S+ (\w+)$', message.read_text('utf-8'), flags=re.MULTILINE))
        found.add(message.stem)
    return frozenset(found)


def topics() -> set[str]:
    """Return the topics and diagnostics of the README, which its own test holds to the code."""
    return set(
        re.findall(r'`(/[\w/]+(?:: \w+)?)`', (ROOT / 'README.md').read_text(encoding='utf-8'))
    )


@cache
def sketches() -> str:
    """Return the code of both sketches."""
    paths = sorted((ROOT / 'firmware').glob('*/*.ino'))
    return '\n'.join(path.read_text(encoding='utf-8') for path in paths)


def is_in_a_sketch(quoted: str) -> bool:
    """Tell whether a sketch has a constant of that name, or says it with … for what varies."""
    if re.search(rf'\b{re.escape(quoted)} = ', sketches()):
        return True
    said = re.findall(r'"([^"\n]+)"', sketches())
    return all(any(part.strip() in text for text in said) for part in quoted.split('…'))


@pytest.mark.parametrize('guide', GUIDES, ids=name_of)
def test_what_stands_in_backticks_exists(guide: Path) -> None:
    strange = [
        span
        for span in spans(guide)
        if not (
            span in names() | topics() | FOREIGN
            or span.startswith(PROGRAMS)
            or is_path(span)
            or is_said(span)
            or is_in_a_sketch(span)
        )
    ]
    assert not strange


def reasons() -> set[str]:
    """Return all for which a candidate is refused."""
    found = {reason.value for reason in Reason}
    for source in (ROOT / 'retrolidar_ros' / 'detector' / 'paper').glob('*.py'):
        found |= set(re.findall(r"rejected\['([^']+)'\]", source.read_text(encoding='utf-8')))
    return found


def test_every_reason_of_the_default_is_explained() -> None:
    text = (DOCS / 'evidence.md').read_text(encoding='utf-8').split('## Reasons')[1]
    assert re.findall(r'^\| `([^`]+)` \|', text, flags=re.MULTILINE) == [
        reason.value for reason in Reason
    ]


def test_the_table_of_reasons_is_complete() -> None:
    table = (DOCS / 'troubleshooting.md').read_text(encoding='utf-8').split('| `rejected: …`')[1]
    rows = re.findall(r'^\| `([^`]+)` \|', table.split('\n\n')[0], flags=re.MULTILINE)
    assert len(rows) == len(set(rows))
    assert set(rows) == reasons()


@pytest.mark.parametrize('guide', GUIDES, ids=name_of)
def test_quoted_reasons_exist(guide: Path) -> None:
    quoted = {span.removeprefix('rejected: ') for span in spans(guide) if 'rejected: ' in span}
    assert quoted - {'…'} <= reasons()


def test_parameters_are_set_to_what_may_be_set_while_running() -> None:
    source = (ROOT / 'retrolidar_ros' / 'nodes' / 'detector.py').read_text(encoding='utf-8')
    for guide in GUIDES:
        text = guide.read_text(encoding='utf-8')
        for parameter in re.findall(r'ros2 param set /retrolidar/detector (\w+)', text):
            declared = re.search(rf"'{parameter}',[^\n]*(?:\n[^\n]*?)*?live=True", source)
            assert declared, parameter


# Commands


def subcommands() -> dict[str, argparse.ArgumentParser]:
    (group,) = (
        action for action in cli.parser()._actions if isinstance(action, argparse._SubParsersAction)
    )
    return dict(group.choices)


def commands(page: Path) -> Iterator[list[str]]:
    """Yield the words of every `retrolidar …` that a page shows."""
    shown = [line.strip() for line in lines_of(page) if line.startswith('    ')] + spans(page)
    for text in shown:
        for match in re.finditer(r'(?:^|embedded/run |\| )retrolidar ([a-z].*)', text):
            yield match[1].split('#')[0].split()


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_every_command_and_option_exists(page: Path) -> None:
    parsers = subcommands()
    for words in commands(page):
        assert words[0] in parsers, ' '.join(words)
        for word in words[1:]:
            if word.startswith('--') and word != '--help':
                assert word in parsers[words[0]]._option_string_actions, ' '.join(words)


# Links


def anchors(page: Path) -> set[str]:
    """Return the anchors that GitHub makes of a page's headings."""
    found = set()
    for line in lines_of(page):
        if heading := re.match(r'#+ (.+)', line):
            plain = re.sub(r'\[([^]]*)\]\([^)]*\)', r'\1', heading[1]).lower()
            found.add(re.sub(r'[^\w\- ]', '', plain).replace(' ', '-'))
    return found


@pytest.mark.parametrize('page', PAGES, ids=name_of)
def test_every_link_leads_somewhere(page: Path) -> None:
    text = '\n'.join(line for line in lines_of(page) if not line.startswith('    '))
    for target in re.findall(r'\]\(([^)\s]+)\)', text):
        if re.match(r'\w+:', target):
            continue
        file, _, anchor = target.partition('#')
        place = (page.parent / file).resolve() if file else page
        assert place.exists(), target
        if anchor:
            assert anchor in anchors(place), target


# What else the guides promise


def test_packets_for_firmware() -> None:
    text = (DOCS / 'hardware.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| (\d+) \| ([01]{7}) ([01]{12}) ([01]{12}) \|', text, flags=re.MULTILINE)
    assert len(rows) == 3
    for identity, *bits in rows:
        assert ''.join(bits) == ''.join(map(str, packet(int(identity))))
        assert bits[0] == ''.join(map(str, PREAMBLE))


@pytest.mark.parametrize(('shape', 'zones'), [('4×4', 16), ('8×8', 64)])
def test_bytes_of_a_frame(shape: str, zones: int) -> None:
    text = (DOCS / 'hardware.md').read_text(encoding='utf-8')
    content = b'\x01' * (wire._HEADER.size + zones * wire._ZONE.itemsize)  # no zeros: the longest
    assert f'| {shape} | {len(wire.encode_packet(content))} |' in text


def test_no_chosen_id_is_one_that_looks_like_a_gap() -> None:
    assert not {1, 4094} & set(choose_ids(314, 8)[0].tolist())


def test_the_pins_of_the_wiring_tables_are_those_of_the_sketches() -> None:
    rows = re.findall(
        r'^\| (\w+) \| `(\w+_PIN)` \|', (ROOT / 'docs/hardware.md').read_text('utf-8'), re.M
    )
    assert sorted((name, pin) for pin, name in rows) == sorted(
        re.findall(r'(\w+_PIN) = (\w+)', sketches())
    )
