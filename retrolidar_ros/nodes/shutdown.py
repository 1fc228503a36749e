# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Termination signals of a process of nodes."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from retrolidar_ros.settings.interrupts import REQUESTS, ignore_requests

# `ros2 launch` sends SIGTERM five seconds after SIGINT.
_GRACE_S = 4.0


def nothing() -> None:
    """Do nothing."""


class ShutdownRequest:
    """Termination signals, and the callbacks they wake."""

    def __init__(self) -> None:
        """Begin before the first one."""
        self.heard = Event()
        self.wake: Callable[[], object] = nothing
        """Is called after `heard` is set, from another thread."""
        self.nodes_destroyed = 0
        """How many nodes have been destroyed since: while it grows, the process is not stuck."""


@contextmanager
def graceful_shutdown() -> Iterator[ShutdownRequest]:
    """Report the first termination signal, and ignore the others.

    Nothing is raised: an exception between any two steps of a library would leave it half done. A
    process that is stuck in its clean-up is ended.
    """
    requests = ShutdownRequest()
    over = Event()
    reading, writing = os.pipe()
    os.set_blocking(writing, False)

    def listen() -> None:
        os.read(reading, 1)
        requests.heard.set()
        requests.wake()
        nodes_destroyed = 0
        while not over.wait(_GRACE_S):
            if requests.nodes_destroyed == nodes_destroyed:
                print('retrolidar_ros: did not end in order, so it was ended', file=sys.stderr)
                os._exit(1)
            nodes_destroyed = requests.nodes_destroyed

    # The number of a signal is written there at once, whatever the main thread waits for.
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    for request in REQUESTS:
        signal.signal(request, lambda *_: None)
    Thread(target=listen, daemon=True).start()
    try:
        yield requests
    finally:
        ignore_requests()
        signal.set_wakeup_fd(-1)
        over.set()
