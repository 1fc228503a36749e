# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the tests of launch files share."""

from typing import Any

import launch_testing.actions
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

INTERRUPTED = 130
"""The exit code of a command that is interrupted."""
SCRIPT = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from retrolidar_ros.settings.resources import shared_file

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


def launched(*actions: Any) -> Any:
    """Return the description of a test that begins at once."""
    return LaunchDescription([*actions, launch_testing.actions.ReadyToTest()])
