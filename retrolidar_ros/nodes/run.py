# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The life of a process of nodes: start, spin, end without a traceback."""

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from threading import Event, Thread

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import InvalidQosOverridesError
from rclpy.signals import SignalHandlerOptions

from retrolidar_ros.settings.interrupts import handle, ignore_requests
from retrolidar_ros.settings.printing import printable


def run(create: Callable[[], Node | list[Node]]) -> int:
    """Spin a node, or several, until interrupted; return the exit code of the process.

    An impossible parameter or parameter file gives one line and exit code 2. Nodes end in their
    order.
    """
    signals = _signals()
    try:
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        # Such as an unreadable parameter file; the place in rcl's sources is left out.
        reason = str(error).partition(', at /')[0].removeprefix('failed to initialize rcl: ')
        print(f'retrolidar_ros: {reason}', file=sys.stderr)
        return 2
    nodes: list[Node] = []
    try:
        created = create()
        nodes = created if isinstance(created, list) else [created]
        _spin(nodes, signals)
    except (ValueError, ParameterException, InvalidQosOverridesError) as error:
        rclpy.logging.get_logger('retrolidar_ros').fatal(printable(str(error)))
        return 2
    except Exception:
        # A failed node shuts the context down, which makes the others fail anywhere.
        if rclpy.ok():
            raise
    finally:
        for node in nodes:  # all at once, before each is waited for
            if stop := getattr(node, 'stop', None):
                stop()
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()
        ignore_requests()  # as the interpreter, when it ends, brings back their default
    return int(any(getattr(node, 'failed', False) for node in nodes))


def repeat(node: Node, period_s: float, callback: Callable[[], None]) -> None:
    """Call something regularly by the steady clock, whatever a replay does to ROS time."""
    node.create_timer(period_s, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def _signals() -> int:
    """Return a file descriptor to which the numbers of termination signals are written.

    They do nothing else: an exception would leave a library half done anywhere, and `ros2 launch`
    passes on the interrupt that a terminal has already sent to all.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing)
    handle(lambda *_: None)
    return reading


def _spin(nodes: list[Node], signals: int) -> None:
    executor = SingleThreadedExecutor()
    for node in nodes:
        executor.add_node(node)
    requested = Event()

    def end() -> None:
        os.read(signals, 1)
        requested.set()
        executor.wake()

    Thread(target=end, daemon=True).start()
    with suppress(ExternalShutdownException):
        while rclpy.ok() and not requested.is_set():
            executor.spin_once()
