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
    """What a node says of itself."""

    level: bytes
    summary: str
    values: dict[str, str]


def publish_health(
    node: Node, subject: str, hardware_id: str, examine: Callable[[], Health]
) -> None:
    """Publish what `examine` returns of a subject once a second, for as long as the node lives."""
    publisher = node.create_publisher(DiagnosticArray, '/diagnostics', 10)

    def publish() -> None:
        health = examine()
        status = DiagnosticStatus(
            level=health.level,
            name=f'{node.get_fully_qualified_name()}: {subject}',
            message=health.summary,
            hardware_id=hardware_id,
            values=[KeyValue(key=key, value=value) for key, value in health.values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)

    # Of the steady clock: a replay that is paused, or a clock that is set, silences nobody.
    node.create_timer(PERIOD_S, publish, clock=Clock(clock_type=ClockType.STEADY_TIME))
