# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The state of a node on `/diagnostics`, once a second."""

import re
from collections.abc import Callable
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from retrolidar_ros.nodes.run import repeat

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE
PERIOD_S = 1.0


class Health(NamedTuple):
    """The health of a node."""

    problems: list[tuple[bytes, str]]  # level and text of each
    values: dict[str, str]
    fine: str = ''  # what is said if there are no problems
    hardware_id: str = ''


HealthCheck = Callable[[], Health]  # judges the time since its last call


class ProblemLog:
    """Logs each kind of problem once, as /diagnostics repeats them."""

    def __init__(self, node: Node) -> None:
        self._logger = node.get_logger()
        self._kinds: set[str] = set()

    def warn(self, problem: str) -> None:
        """Log a problem, unless it was logged before with other numbers."""
        kind = re.sub(r'[\d.]+', '', problem)
        if kind not in self._kinds:
            self._kinds.add(kind)
            self._logger.warning(problem)


class DiagnosticsPublisher:
    """Publishes the health of all nodes of a process, in one message a second."""

    def __init__(self, node: Node) -> None:
        """Publish in the name of `node`, for as long as it lives."""
        self._node = node
        self._subjects: list[tuple[str, HealthCheck]] = []
        self._publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        repeat(node, PERIOD_S, self._publish)

    def register_health_check(self, node: Node, subject: str, check: HealthCheck) -> None:
        """Publish the result of `check`, too."""
        name = f'{node.get_fully_qualified_name()}: {subject}'
        self._subjects.append((name, check))

    def _publish(self) -> None:
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        for name, check in self._subjects:
            health = check()
            problems = sorted(health.problems, key=lambda problem: problem[0], reverse=True)
            status = DiagnosticStatus(
                level=problems[0][0] if problems else OK,
                name=name,
                message='; '.join(text for _, text in problems) or health.fine,
                hardware_id=health.hardware_id,
            )
            status.values = [KeyValue(key=key, value=value) for key, value in health.values.items()]
            message.status.append(status)
        self._publisher.publish(message)
