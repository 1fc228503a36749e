# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults that are put into core and product on purpose: which ones does no test notice?

Each is a comparison or logical operator turned round, or a call left out, in a copy of the
repository; or, as `parts`, a part of the decision switched off.

    make mutants ARGS="--count 40 --seed 1 core detector"
    make mutants ARGS=parts
"""

import argparse
import io
import itertools
import os
import random
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tokenize
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from evaluation.bench.core_parts import PARTS

ROOT = Path(__file__).resolve().parents[1]
DECISION_TESTS = 'test/detector/test_{oracle,decision_parts}.py'
CORE_TESTS = (
    'test/detector/test_pinned_reading.py',
    'test/detector test/firmware test/marker test/sensor',
)
FOLDERS: dict[str, tuple[str, ...]] = {
    'core': ('core/src', *CORE_TESTS),
    'parts': ('core/src', DECISION_TESTS, *CORE_TESTS),
    'detector': (
        'retrolidar_ros/detector',
        'test/detector/test_{detector,decoding,explain,place}.py',
        'test/cli/test_{calibrate,watch_state}.py',
        'test/detector/test_{tracks,core_parts,invariance,pinned_reading}.py',
    ),
    'sensor': ('retrolidar_ros/sensor', 'test/sensor test/firmware'),
    'marker': ('retrolidar_ros/marker', 'test/marker test/scene'),
    'scene': ('retrolidar_ros/scene', 'test/scene'),
    'bag': ('retrolidar_ros/bag', 'test/bag'),
    'tasks': ('retrolidar_ros/tasks', 'test/tasks'),
    'settings': ('retrolidar_ros/settings', 'test/settings test/scene'),
}
"""What is changed, by a name, and runs of tests that are to notice; most telling ones first."""
OPPOSITES = (('<', '>='), ('<=', '>'), ('==', '!='), ('&&', '||'), ('and', 'or'))
TURNED = dict(OPPOSITES) | {second: first for first, second in OPPOSITES}
OPERATOR = re.compile(r' (<=|>=|==|!=|<|>|&&|\|\|) ')
CALL = re.compile(r'^\s+(?!return|raise|yield|assert|del)[\w.>-]+\(.*\);?$')
COMMENT = re.compile(r'/\*.*?\*/', re.DOTALL)
TIMEOUT_S = 900
MAKEFILE = """
{module}: $(patsubst %.c,objects/%.o,_core.c $(notdir $(wildcard core/src/*.c)))
	cc -shared $^ -lm -o $@
objects/%.o: %.c
	cc {flags} -w -fPIC -Icore/src -I{headers} -c $< -o $@
vpath %.c core/src objects
"""


class Mutant(NamedTuple):
    """One change of a source."""

    folder: str
    file: Path
    """From the root."""
    begin: int
    """Of the characters that go."""
    end: int
    text: str
    """What stands there then."""
    name: str


def operators(path: Path) -> Iterator[tuple[int, int, str]]:
    """Yield line, column and text of the operators in a source, those of comments left out."""
    text = path.read_text()
    if path.suffix == '.py':
        for one in tokenize.generate_tokens(io.StringIO(text).readline):
            if one.type in (tokenize.OP, tokenize.NAME) and one.string in TURNED:
                yield one.start[0] - 1, one.start[1], one.string
        return
    code = COMMENT.sub(lambda found: re.sub(r'[^\n]', ' ', found[0]), text)
    for number, line in enumerate(code.splitlines()):
        yield from ((number, found.start(1), found[1]) for found in OPERATOR.finditer(line))


def changes_of(path: Path) -> Iterator[tuple[int, int, str, str]]:
    """Yield line and column of every change of a source, what goes, and what stands there then."""
    for number, column, old in operators(path):
        yield number, column, old, TURNED[old]
    for number, line in enumerate(path.read_text().splitlines()):
        if CALL.match(line):
            column = len(line) - len(line.lstrip())
            yield number, column, line.strip(), ';' if path.suffix == '.c' else 'pass'


def mutants_of(folder: str) -> Iterator[Mutant]:
    """Yield all changes of the sources of a folder."""
    if folder == 'parts':
        for name, part in PARTS.items():
            file = Path(FOLDERS[folder][0]) / f'retrolidar_{part.file}.c'
            begin = (ROOT / file).read_text().index(part.line)
            yield Mutant(folder, file, begin, begin + len(part.line), part.without, name)
        return
    for path in sorted((ROOT / FOLDERS[folder][0]).rglob('*.*')):
        if path.suffix not in ('.c', '.py'):
            continue
        lines = path.read_text().splitlines(keepends=True)
        starts = [0, *itertools.accumulate(map(len, lines))]
        for number, column, old, new in changes_of(path):
            begin = starts[number] + column
            name = f'{number + 1}: {old} becomes {new}: {lines[number].strip()}'
            yield Mutant(folder, path.relative_to(ROOT), begin, begin + len(old), new, name)


class Copy:
    """A copy of the repository that mutants change."""

    def __init__(self, root: Path) -> None:
        """Copy what git knows, and what was built."""
        self._root = root
        names = subprocess.check_output(['git', 'ls-files', '-z'], cwd=ROOT, text=True)
        for name in names.split('\0')[:-1]:
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, root / name)
        for name in ('.venv', 'install'):
            (root / name).symlink_to(ROOT / name)
        (built,) = ROOT.glob('install/lib/python3.*/site-packages/retrolidar_ros')
        for path in built.iterdir():
            if path.name == 'msg' or path.suffix == '.so':
                (root / 'retrolidar_ros' / path.name).symlink_to(path.resolve())
        (module,) = (root / 'retrolidar_ros').glob('_core.*.so')
        module.unlink()
        (root / 'objects').mkdir()
        flags = ' '.join((ROOT / 'core/compile_flags.txt').read_text().split())
        headers = sysconfig.get_path('include')
        text = MAKEFILE.format(module=module.relative_to(root), flags=flags, headers=headers)
        (root / 'objects/Makefile').write_text(text)
        self.run(f'{shlex.quote(sys.executable)} core/binding.py objects/_core.c')
        if not self.compiles():
            sys.exit('the core does not compile without any mutant')

    def run(self, command: str) -> int:
        """Run a command in the environment of the package, with the copy before it."""
        line = f'PYTHONPATH={self._root}:$PYTHONPATH exec timeout -s KILL {TIMEOUT_S} {command}'
        return subprocess.run(
            [str(self._root / 'embedded/run'), 'bash', '-c', line],
            cwd=self._root,
            env={**os.environ, 'PYTHONDONTWRITEBYTECODE': '1'},
            capture_output=True,
            check=False,
        ).returncode

    def compiles(self) -> bool:
        """Compile what has changed of the core; return whether that was possible."""
        return self.run('make -f objects/Makefile') == 0

    def passes(self, folder: str, file: Path | None = None) -> bool:
        """Return whether all tests of a folder pass, of which those of a file come first."""
        own = sorted(self._root.glob(f'test/*/test_{file.stem}*.py')) if file else []
        runs = [' '.join(map(str, own))] if own else []
        pytest = 'pytest -q -x -n 0 -p no:cacheprovider --timeout 300'
        return all(self.run(f'{pytest} {tests}') == 0 for tests in [*runs, *FOLDERS[folder][1:]])

    def notices(self, mutant: Mutant) -> bool:
        """Return whether a test fails, or nothing compiles, with a mutant."""
        path = self._root / mutant.file
        whole = path.read_text()
        path.write_text(whole[: mutant.begin] + mutant.text + whole[mutant.end :])
        try:
            return not (self.compiles() and self.passes(mutant.folder, mutant.file))
        finally:
            path.write_text(whole)
            self.compiles()


def main() -> None:
    """Try a random sample, and print what no test has noticed."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('folders', nargs='*', metavar='FOLDER', help=f'of {", ".join(FOLDERS)}')
    parser.add_argument(
        '--count', type=int, default=40, help='how many, but of `parts` all (default: %(default)s)'
    )
    parser.add_argument('--seed', type=int, default=0, help='which ones (default: %(default)s)')
    arguments = parser.parse_args()
    sample = [one for name in arguments.folders or FOLDERS for one in mutants_of(name)]
    if arguments.folders != ['parts']:
        sample = random.Random(arguments.seed).sample(sample, min(arguments.count, len(sample)))
    survivors = 0
    with tempfile.TemporaryDirectory(prefix='mutants_') as directory:
        copy = Copy(Path(directory))
        for name in {one.folder for one in sample}:
            if not copy.passes(name):
                sys.exit(f'{name}: its tests fail without any mutant')
        for tried, mutant in enumerate(sorted(sample), 1):
            if not copy.notices(mutant):
                survivors += 1
                print(f'{mutant.file}:{mutant.name}', flush=True)
            print(f'{tried} tried, {survivors} survive', file=sys.stderr, flush=True)
    print(f'{survivors} of {len(sample)} survive, {survivors / max(len(sample), 1):.0%}')


if __name__ == '__main__':
    main()
