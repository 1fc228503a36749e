# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The life of a node's process: start, spin, end without a traceback."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node

from retrolidar_ros.settings.interrupts import ignore_requests


def run(create: Callable[[], Node]) -> int:
    """Spin a node until it is interrupted; return the exit code of the process.

    A parameter or a parameter file that cannot be is one clear line and the exit code 2.
    """
    try:
        rclpy.init()
    except RuntimeError as error:
        # A parameter file that cannot be read, say; where in rcl's sources is no help.
        reason = str(error).partition(', at /')[0].removeprefix('failed to initialize rcl: ')
        print(f'retrolidar_ros: {reason}', file=sys.stderr)
        return 2
    node = None
    try:
        try:
            node = create()
        except (ValueError, InvalidParameterTypeException, InvalidParameterValueException) as error:
            rclpy.logging.get_logger('retrolidar_ros').fatal(str(error))
            return 2
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        # A request to end that comes while the node is being made lets that fail somewhere.
        if rclpy.ok():
            raise
    finally:
        ignore_requests()
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    return 1 if getattr(node, 'failed', False) else 0
