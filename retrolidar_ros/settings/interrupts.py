# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Termination signals: handled once, so that the clean-up is not cut short."""

import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from threading import Event
from types import FrameType
from typing import Any

REQUESTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def handle(
    handler: Callable[[int, FrameType | None], object],
    requests: Sequence[signal.Signals] = REQUESTS,
) -> dict[signal.Signals, Any]:
    """Let a function handle termination signals; return their handlers before.

    One that is ignored stays ignored, as SIGHUP by `nohup`; but not SIGINT, which a script ignores
    for its background jobs unasked: `kill -INT` ends them, as it does those of rclcpp and rclpy.
    """
    return {
        one: signal.signal(one, handler)
        for one in requests
        if one is signal.SIGINT or signal.getsignal(one) is not signal.SIG_IGN
    }


def ignore_requests() -> None:
    """Ignore further signals, which must not cut the clean-up short; `ros2 launch` sends two."""
    for request in REQUESTS:
        signal.signal(request, signal.SIG_IGN)


def exit_by(number: int, frame: FrameType | None) -> None:
    """Exit by an exception, so that files and processes made for a while are ended, too."""
    raise SystemExit(128 + number)


@contextmanager
def ended_quietly() -> Iterator[None]:
    """Let Ctrl-C end the process at once while modules are imported, without a traceback."""
    handler = signal.getsignal(signal.SIGINT)
    if handler is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


@contextmanager
def interrupted_once() -> Iterator[None]:
    """Raise KeyboardInterrupt at the first termination signal, and ignore the others."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        ignore_requests()
        raise KeyboardInterrupt

    with _handled_by(interrupt):
        yield


@contextmanager
def termination_noted() -> Iterator[Event]:
    """Yield an event that a termination signal sets, so that a file can be completed first."""
    requested = Event()
    with _handled_by(lambda number, frame: requested.set()):
        yield requested


@contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], object]) -> Iterator[None]:
    before = handle(handler)
    try:
        yield
    finally:
        for request, previous in before.items():
            signal.signal(request, previous)
