# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
import signal
import sys
from pathlib import Path

import pytest

# Of small matrices many threads only make more work; to be said before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# The nodes of workers of pytest-xdist, which run at the same time, must not hear each other.
if worker := os.environ.get('PYTEST_XDIST_WORKER'):
    domain = int(os.environ.get('ROS_DOMAIN_ID', '0')) + 50 * int(worker.removeprefix('gw'))
    os.environ['ROS_DOMAIN_ID'] = str(domain % 100)

# A shell lets its background jobs ignore SIGINT, and so do all that these start; but the tests
# end processes by it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Experiments are not installed. Last, so that the package that is built comes before its sources.
sys.path.append(str(Path(__file__).resolve().parents[1]))

IN_REAL_TIME = {'nodes', 'launch', 'docs'}


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest, so that workers end at the same time."""
    for item in items:
        if IN_REAL_TIME & set(item.path.parts):
            item.add_marker('slow')
    items.sort(key=lambda item: item.get_closest_marker('slow') is None)
