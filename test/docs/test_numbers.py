# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of search, decision and placement: their table in docs/detector.md against core/src.

Run as a script, it writes names, files, values and counts anew from the sources. Units and origins
stay; those of a number that is new, and not one renamed, are to be written by hand.
"""

import re
from collections import Counter
from pathlib import Path

from evaluation.bench.core_numbers import NUMBERS, number_changes

ROOT = Path(__file__).parents[2]
PAGE = ROOT / 'docs' / 'detector.md'
HEADER = '|name|file|value|unit|from|\n|---|---|---|---|---|\n'
# A value that follows from other numbers is none of its own.
DERIVED = r'[^{]*\bRL_\w+[^{]*|[^{]*\b[A-Z]{2,}_?[A-Z]+[^{]*'
# The sensor and the packet, what talks to sensors and firmware, and tracks.
OTHER_FILES = {
    *('command', 'marker', 'packet', 'packet_format', 'receive'),
    *('sensor', 'wire'),
    *('followed', 'followed_range', 'presence', 'range_filter', 'tracks', 'tracks_begin'),
    *('pose', 'zone_light'),
}
# What no one chose: constants of maths, and of the layout of arrays.
NOT_CHOSEN = {
    'bearing': {
        'PLACES',
        'FROM',
        'MIN_DOUBT',
        'SQRT_2',
        'HOPELESS',
        'AXES',
        'STRETCHES',
        'RL_PLACES',
        'RL_BLURS',
        'RL_NEAR',
    },
    'blinking_range': {'NO_BLINKING'},
    'clock': {'MAX_CORRELATION', 'MAX_BITS'},
    'codebook': {'MIN_ENERGY', 'RL_GROUPS'},
    'constants': {'RL_LANES'},
    'detector': {'RL_MAX_READ'},
    'detector_state': {'RL_POOL', 'RL_READINGS'},
    'hits': {'MAX_EXPLAINED'},
    'lanes': {'ERASED'},
    'likelihood': {'NO_ENERGY', 'RL_WALKS', 'RL_WALK_LANES'},
    'process_frame': {'FOLDS'},
    'ranging': {'TWO_PI', 'OWN', 'DARK', 'MIN_DISTANCES', 'RL_NEAREST_M', 'RL_MAX_OTHERS'},
    'samples': {'MIN_EXPOSURE_S', 'RL_MAX_CHANNELS'},
    'search': {'WALK_COUNT', 'FAINT_LONE', 'FINE'},
    'target': {'FINE', 'BINS', 'RL_NO_REFERENCE'},
    'template': {'LN_9'},
    'view': {'NOTHING'},
}


def _split(text: str) -> list[str]:
    """Split at the commas that are in no braces or parentheses."""
    return re.findall(r'(?:[^,{(]|\{[^}]*\}|\([^)]*\))+', text)


def _constants(source: str) -> list[tuple[str, str]]:
    """Return names and values of what a source declares as static constants, or enumerates."""
    text = re.sub(r'/\*.*?\*/', ' ', source, flags=re.S)
    declared = re.findall(
        r'(?:\bstatic |^)const (?:double|float|u?int\w*) ([^;()]*?=[^;]*);', text, re.M
    )
    listed = re.findall(r'\benum(?: \w+)? \{([^}]*)\}', text)
    pairs = [one.partition('=') for group in declared + listed for one in _split(group)]
    return [
        (name.split('[')[0].strip(), re.sub(r'\s|(?<=\d)f\b', '', value))
        for name, equals, value in pairs
        if equals and not re.fullmatch(DERIVED, value.strip())
    ]


def constants() -> list[tuple[str, str, str]]:
    """Return name, file and value of each constant, by file and in the order of the source."""
    found = []
    for path in sorted((ROOT / 'core' / 'src').glob('retrolidar_*.[ch]')):
        file = path.stem.removeprefix('retrolidar_')
        if file not in OTHER_FILES:
            found += [(*one, file) for one in _constants(path.read_text(encoding='utf-8'))]
    return [(name, file, value) for name, value, file in found]


def written(page: str) -> str:
    """Return a page with the table, and the counts before it, as the sources have them."""
    before, header, after = page.partition(HEADER)
    old, _, rest = after.partition('\n\n')
    numbers = [
        (f'`{name}`', file, f'`{value}`')
        for name, file, value in constants()
        if name not in NOT_CHOSEN.get(file, ())
    ]
    present = {(name, file) for name, file, _ in numbers}
    known, renamed = {}, {}
    for line in old.splitlines():
        name, file, value, *written_by_hand = line[1:-1].split('|')
        known[name, file] = written_by_hand
        if (name, file) not in present:
            renamed[file, value] = written_by_hand
    lines, origins = [], Counter[str]()
    for name, file, value in numbers:
        unit, origin = known.get((name, file)) or renamed.get((file, value)) or ('', '')
        lines.append(f'|{name}|{file}|{value}|{unit}|{origin}|\n')
        origins[origin] += 1
    counts = ', '.join(f'{count} {origin}' for origin, count in origins.most_common())
    more = sum(map(len, NOT_CHOSEN.values()))
    counted = f'{origins.total()} numbers: {counts}; {more} more are maths or layout of arrays.'
    before = re.sub(r'\n\d+ numbers: .*\n', f'\n{counted}\n', before)
    return before + header + ''.join(lines) + '\n' + rest


def test_the_table_is_that_of_the_sources() -> None:
    page = PAGE.read_text(encoding='utf-8')
    assert page == written(page)


def test_what_is_not_chosen_is_in_the_sources() -> None:
    listed = {(name, file) for file, names in NOT_CHOSEN.items() for name in names}
    assert listed <= {(name, file) for name, file, _ in constants()}


def test_every_number_says_where_it_comes_from() -> None:
    before, _, after = PAGE.read_text(encoding='utf-8').partition(HEADER)
    explained = set(re.findall(r'\*(\w+)\*', before.rpartition('\n## ')[2]))
    lines = after.partition('\n\n')[0].splitlines()
    assert {line[1:-1].split('|')[4] for line in lines} == explained


def test_those_that_were_swept_are_those_of_the_experiment() -> None:
    page = PAGE.read_text(encoding='utf-8')
    swept = re.findall(r'^\|`(\w+)`\|(\w+)\|.*\|swept\|$', page, re.M)
    in_experiment = [(name, file.split('.')[0]) for file in NUMBERS for name in NUMBERS[file]]
    assert sorted(swept) == sorted(in_experiment)
    for name, (change,) in number_changes().items():
        assert change.without != change.line, name


if __name__ == '__main__':
    PAGE.write_text(written(PAGE.read_text(encoding='utf-8')), encoding='utf-8')
