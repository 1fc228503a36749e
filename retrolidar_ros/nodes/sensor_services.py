# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The services `~/start`, `~/stop` and `~/reset` of a driver, for its sensor."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from std_srvs.srv import Trigger

from retrolidar_ros.sensor.identity import Command
from retrolidar_ros.sensor.serial_source import SerialSource

# Timeout of an answer: a sensor needs a frame period, and the reading thread 0.2 s.
_PATIENCE_S = 1.0
_DONE = {
    Command.START: 'the sensor is ranging',
    Command.STOP: 'the sensor is stopped',
    Command.RESET: 'the sensor restarts',
}


def offer_services(node: Node, source: Callable[[], SerialSource | None]) -> None:
    """Offer the services; `source` returns what reads the port, if the node is configured.

    An answer blocks the executor, but no frame, for a second at most.
    """

    def serve(command: Command, _: Any, response: Trigger.Response) -> Trigger.Response:
        problem = _command(source(), command)
        response.success, response.message = not problem, problem or _DONE[command]
        return response

    for command in _DONE:
        node.create_service(Trigger, f'~/{command.value}', partial(serve, command))


def _command(source: SerialSource | None, command: Command) -> str:
    """Send a command; return why it has no effect, or ''."""
    if source is None:
        return 'not configured: the port is closed'
    if not source.is_open:
        return source.problem
    if source.reader.commands is None:
        return 'this protocol has no commands'
    try:
        is_done = source.reader.commands.ask(command, _PATIENCE_S)
    except TimeoutError as error:
        return f'{error}: flash a firmware that knows commands, such as firmware/reader'
    return '' if is_done else f'the sensor has not obeyed {command.value}'
