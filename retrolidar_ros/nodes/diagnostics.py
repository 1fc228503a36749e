# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of a node on `/diagnostics`, once a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE
PERIOD_S = 1.0


class Health(NamedTuple):
    """The health of a node."""

    level: bytes
    summary: str
    values: dict[str, str]
    hardware_id: str = ''
    """Of the hardware, if it became known after the node started."""

    def plus(self, level: bytes, problem: str) -> Health:
        """Return this health with another problem; as it is if that is empty."""
        if not problem:
            return self
        summary = problem if self.level == OK else f'{self.summary}; {problem}'
        return self._replace(level=max(self.level, level), summary=summary)


HealthCheck = Callable[[], 'Health | None']
"""Judges the time since its last call; None if there is nothing to report."""


def health_of(problems: list[tuple[bytes, str]], fine: str, values: dict[str, str]) -> Health:
    """Return problems as one health, the worst first; `fine` if there are none."""
    health = Health(OK, fine, values)
    for problem in sorted(problems, key=lambda problem: problem[0], reverse=True):
        health = health.plus(*problem)
    return health


class DiagnosticsPublisher:
    """Publishes the health of all nodes of a process, in one message a second."""

    def __init__(self, node: Node) -> None:
        """Publish in the name of `node`, for as long as it lives."""
        self._node = node
        self._subjects: list[tuple[str, str, HealthCheck]] = []
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        # Of the steady clock: a paused replay, or a clock change, must not stop diagnostics.
        node.create_timer(PERIOD_S, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def add(self, name: str, hardware_id: str, examine: HealthCheck) -> None:
        """Publish the result of `examine`, too."""
        self._subjects.append((name, hardware_id, examine))

    def _publish(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        for name, hardware_id, examine in self._subjects:
            if (health := examine()) is not None:
                status = DiagnosticStatus(
                    level=health.level,
                    name=name,
                    message=health.summary,
                    hardware_id=health.hardware_id or hardware_id,
                )
                status.values = [KeyValue(key=key, value=one) for key, one in health.values.items()]
                message.status.append(status)
        self._publisher.publish(message)


def register_health_check(
    node: Node,
    subject: str,
    hardware_id: str,
    examine: HealthCheck,
    board: DiagnosticsPublisher | None = None,
) -> DiagnosticsPublisher:
    """Publish what `examine` returns once a second, on a new board or a given one; return that."""
    board = DiagnosticsPublisher(node) if board is None else board
    board.add(f'{node.get_fully_qualified_name()}: {subject}', hardware_id, examine)
    return board
