# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of launch files share."""

import os
import signal
import unittest
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any
from unittest.mock import patch

import launch_testing.actions
from harness_observer import Observer
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription, SetEnvironmentVariable
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

# A shell lets its background jobs ignore SIGINT, and so do all that these start; but launches are
# ended by it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_INTERRUPTED = 130
_COMMANDS = ('emulator', 'server')  # they say that they were interrupted
_DOMAIN = 'ROS_DOMAIN_ID'
# Above the ports that Linux gives to others; launch_test picks one from those below them.
_FIRST_DOMAIN, _DOMAINS = 215, 18
SCRIPT = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from retrolidar_ros.settings.files import shared_file

arguments = [argument.split(':=', 1) for argument in sys.argv[2:]]
include = IncludeLaunchDescription(str(shared_file(f'launch/{sys.argv[1]}.launch.py')),
                                   launch_arguments=arguments)
service = LaunchService()
service.include_launch_description(LaunchDescription([include]))
sys.exit(service.run())
"""
"""Launches a file of the package: its name, and arguments."""


def included(name: str, **arguments: str) -> Any:
    """Return the action that includes `NAME.launch.py` of the package."""
    file = PathJoinSubstitution([FindPackageShare('retrolidar_ros'), 'launch', f'{name}.launch.py'])
    return IncludeLaunchDescription(file, launch_arguments=arguments.items())


def domain_of(index: int) -> str:
    """Return the domain of one of several systems of a test, which stay apart."""
    own = int(os.environ.get(_DOMAIN, '0'))
    return str(_FIRST_DOMAIN + (10 * own + index) % _DOMAINS)


def in_domain(domain: str, *actions: Any) -> Any:
    """Return actions whose processes are in a domain."""
    return GroupAction([SetEnvironmentVariable(_DOMAIN, domain), *actions])


def observer_in(domain: str, namespace: str, **environment: str) -> Observer:
    """Return an observer of a namespace in a domain."""
    with patch.dict(os.environ, {_DOMAIN: domain, **environment}):
        return Observer(namespace)


def check_at_once(
    test: unittest.TestCase,
    checks: Mapping[str, Callable[[Observer], None]],
    observers: Mapping[str, Observer],
) -> None:
    """Check several systems, each with its observer in a thread of its own."""
    with ThreadPoolExecutor(len(checks)) as pool:
        results = {name: pool.submit(check, observers[name]) for name, check in checks.items()}
    for name, result in results.items():
        with test.subTest(name):
            result.result()


def check_exit_codes(proc_info: Any, *allowed: int) -> None:
    """Check that nodes ended with 0, commands may also say that they were interrupted."""
    for info in proc_info:
        is_command = info.process_name.rpartition('-')[0] in _COMMANDS
        codes = [0, *allowed, *([_INTERRUPTED] if is_command else [])]
        assert info.returncode in codes, (info.process_name, info.returncode)


def processes() -> Iterator[tuple[int, str]]:
    """Yield all processes there are, by their numbers and command lines."""
    for file in Path('/proc').glob('[0-9]*/cmdline'):
        with suppress(OSError):
            yield int(file.parent.name), file.read_text()


def launched(*actions: Any) -> Any:
    """Return the description of a test that begins at once."""
    return LaunchDescription([*actions, launch_testing.actions.ReadyToTest()])
