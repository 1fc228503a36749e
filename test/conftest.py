# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
import re
import signal
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# A law is tried on the same examples each time, however long each takes on a busy machine.
settings.register_profile('laws', deadline=None, derandomize=True)
settings.load_profile('laws')

# Of small matrices many threads only make more work; to be said before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# The nodes of workers of pytest-xdist, which run at the same time, must not hear each other.
if worker := os.environ.get('PYTEST_XDIST_WORKER'):
    domain = int(os.environ.get('ROS_DOMAIN_ID', '0')) + 20 * int(worker.removeprefix('gw'))
    os.environ['ROS_DOMAIN_ID'] = str(domain % 100)

# A shell lets its background jobs ignore SIGINT, and so do all that these start; but the tests
# end processes by it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# So does nohup with SIGHUP, and what ignores it goes on ignoring it.
signal.signal(signal.SIGHUP, signal.SIG_DFL)

# Experiments are not installed. Last, so that the package that is built comes before its sources.
sys.path.append(str(Path(__file__).resolve().parents[1]))

HERE = Path(__file__).resolve().parent
NEEDED = {
    'evaluation': ('pyapriltags',),  # experiments need libraries from pip, not of robots
    'harness|harness_observer|retrolidar_ros.nodes': ('rclpy', 'retrolidar_ros.msg'),
}
"""What tests that import these modules need."""
# Those of the launch files are for launch_test.
collect_ignore = ['launch']
missing = {
    path.relative_to(HERE): module
    for path in HERE.rglob('test_*.py')
    for imported, modules in NEEDED.items()
    if re.search(rf'^(from|import) ({imported})\b', path.read_text(encoding='utf-8'), re.M)
    for module in modules
    if find_spec(module) is None
}
collect_ignore += map(str, missing)


def pytest_report_header() -> list[str]:
    """Say what is not tested, and why."""
    return [f'without {module}: no {path}' for path, module in missing.items()]


# In real time, with many processes, or with much to compute.
SLOW = {'nodes', 'launch', 'docs', 'evaluation', 'test_watch.py'}
SLOW |= {
    'test_core_robustness.py',
    'test_invariance.py',
    'test_oracle.py',
    'test_parts.py',
    'test_pinned_reading.py',
}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow ones and begin with them, so that workers end at the same time."""
    for item in items:
        if SLOW & set(Path(str(item.fspath)).parts):  # .path is not in pytest 6 of Humble
            item.add_marker('slow')
    items.sort(key=lambda item: item.get_closest_marker('slow') is None)


@pytest.fixture
def link(tmp_path: Path) -> Path:
    """Give the path at which a port will be."""
    return tmp_path / 'port'


@pytest.fixture(scope='module')
def core(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Give the statistics of the core."""
    from harness_core import Statistics

    return Statistics(tmp_path_factory)


@pytest.fixture(scope='session')
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile both sketches, which checks their types; give where their programs are."""
    from harness_firmware import FIRMWARE, make, need, shared_build

    need('make', 'cc', 'c++')
    build = shared_build(tmp_path_factory, 'firmware')
    make(FIRMWARE, build, 'host')
    return build
