# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Child processes that end with their parent."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
from contextlib import suppress
from pathlib import Path

from retrolidar_ros.settings.interrupts import exit_by, handle

_PATIENCE_S = 5.0
_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1  # of <sys/prctl.h>
_ENDING = (signal.SIGTERM, signal.SIGHUP)


class ProcessError(RuntimeError):
    """A process ended that should have run on; the message holds the end of its log."""


class ProcessGroup:
    """Runs programs, with log files, and ends all of them on exit, SIGTERM or SIGHUP."""

    def __init__(self, logs: Path) -> None:
        self._logs = logs
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def __enter__(self) -> ProcessGroup:
        """Turn both signals into SystemExit, so that leaving the block ends the processes."""
        self._old_handlers = handle(exit_by, _ENDING)
        return self

    def __exit__(self, *_: object) -> None:
        """End all processes: by SIGINT, and by SIGKILL what ignores it."""
        try:
            for name in list(self._running):
                self.stop(name)
        finally:  # a second Ctrl-C or SIGTERM ends the waiting
            for process in self._running.values():
                _signal(process.pid, signal.SIGKILL)
                process.wait()
            self._running.clear()
            for number, handler in self._old_handlers.items():
                signal.signal(number, handler)

    def start(self, name: str, command: list[str]) -> None:
        """Run a command under a name of one's choice; ValueError if it runs already."""
        if name in self._running:
            raise ValueError(f'{name} has been started already')
        with self.log(name).open('wb') as log:
            # A group of its own: Ctrl-C in a terminal reaches this process only, which then
            # ends the others in order, their own children included.
            self._running[name] = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )

    def log(self, name: str) -> Path:
        """Return the file with the output of a process."""
        return self._logs / f'{name}.log'

    def pid(self, name: str) -> int:
        """Return the process ID of a running process."""
        return self._running[name].pid

    def stop(self, name: str) -> int:
        """End one process and its children; return its exit code."""
        process = self._running[name]
        _signal(process.pid, signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE_S)
        _signal(process.pid, signal.SIGKILL)  # what ignored that, children included
        code = process.wait()
        del self._running[name]
        return code

    def check(self) -> None:
        """Raise ProcessError if a process has ended by itself."""
        for name, process in self._running.items():
            if process.poll() is not None:
                lines = self.log(name).read_text(errors='replace').splitlines()[-15:]
                raise ProcessError(
                    f'{name} ended with exit code {process.returncode}:\n' + '\n'.join(lines)
                )


def end_with_parent(parent: int | None = None) -> None:
    """Let the kernel end this process when its parent, of this ID, is gone, be it by SIGKILL."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if parent not in (None, os.getppid()):
        os._exit(1)


def _signal(group: int, number: signal.Signals) -> None:
    """Send a signal to a process group that may be gone."""
    with suppress(ProcessLookupError):
        os.killpg(group, number)
