# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Install the part that needs no ROS: the Python package and the `retrolidar` command.

With ROS, CMakeLists.txt installs everything; pip is for a laptop without it.
"""

from __future__ import annotations

from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.build_ext import build_ext
from setuptools.errors import CompileError

BAGS = ['rosbags>=0.11']
EVALUATION = ['pyapriltags', 'pyzbar', 'segno']
TEST = ['cobs', 'hypothesis', 'komm', 'mcap', 'pytest', 'pytest-timeout', 'pytest-xdist']


def shared_files() -> list[tuple[str, list[str]]]:
    """Return what goes to share/retrolidar_ros, in the layout that ament gives it."""
    files = [Path('package.xml')]
    for directory in ('config', 'launch', 'msg', 'udev', 'urdf'):
        files += (path for path in Path(directory).rglob('*') if path.is_file())
    share = Path('share/retrolidar_ros')
    return [(str(share / path.parent), [str(path)]) for path in files if path.suffix != '.pyc']


class BuildCore(build_ext):  # type: ignore[misc]  # setuptools has no types
    """Compiles the core, or says what that needs."""

    def build_extensions(self) -> None:
        """Compile."""
        try:
            super().build_extensions()
        except CompileError as error:
            raise CompileError(
                f'retrolidar_ros needs a C compiler and the headers of Python ({error}): '
                'apt install build-essential python3-dev'
            ) from None


setup(
    name='retrolidar_ros',
    version='0.1.0',
    description='Reads liquid-crystal markers with a VL53L8CX time-of-flight sensor',
    author='retrolidar_ros maintainers',
    author_email='maintainers@users.noreply.github.com',
    license='Apache-2.0',
    python_requires='>=3.10',
    packages=find_packages(include=['retrolidar_ros', 'retrolidar_ros.*']),
    data_files=shared_files(),
    cffi_modules=['core/binding.py:ffi'],
    cmdclass={'build_ext': BuildCore},
    install_requires=['cffi', 'matplotlib', 'numpy', 'pyserial', 'pyyaml'],
    extras_require={
        'bags': BAGS,
        'evaluation': [*BAGS, *EVALUATION],
        'test': [*BAGS, *EVALUATION, *TEST],
    },
    entry_points={'console_scripts': ['retrolidar=retrolidar_ros.cli.__main__:main']},
)
