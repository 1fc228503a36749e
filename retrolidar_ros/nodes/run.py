# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The life of a process of nodes: start, spin, end without a traceback."""

from __future__ import annotations

import sys
from collections.abc import Callable

import rclpy
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError

from retrolidar_ros.settings.interrupts import ignore_requests
from retrolidar_ros.settings.printing import printable

_IMPOSSIBLE = (
    ValueError,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    InvalidQosOverridesError,
)


def run(create: Callable[[], Node | list[Node]]) -> int:
    """Spin a node, or several, until interrupted; return the exit code of the process.

    A parameter or a parameter file that cannot be is one clear line and the exit code 2. Nodes end
    in the order in which they are listed.
    """
    try:
        rclpy.init()
    except RuntimeError as error:
        # A parameter file that cannot be read, say; where in rcl's sources is no help.
        reason = str(error).partition(', at /')[0].removeprefix('failed to initialize rcl: ')
        print(f'retrolidar_ros: {reason}', file=sys.stderr)
        return 2
    nodes: list[Node] = []
    try:
        try:
            created = create()
        except _IMPOSSIBLE as error:
            rclpy.logging.get_logger('retrolidar_ros').fatal(printable(str(error)))
            return 2
        nodes = created if isinstance(created, list) else [created]
        executor = SingleThreadedExecutor()
        for node in nodes:
            executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except Exception:
        # A request to end that comes while the node is being made lets that fail somewhere.
        if rclpy.ok():
            raise
    finally:
        ignore_requests()
        for node in nodes:  # all at once, before each is waited for
            getattr(node, 'stop', bool)()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
    return int(any(getattr(node, 'failed', False) for node in nodes))
