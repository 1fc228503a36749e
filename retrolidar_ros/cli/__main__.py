# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the command begins when it is run as a program: before what takes time to import."""

from __future__ import annotations

import signal
import sys
from types import FrameType

from retrolidar_ros.settings.interrupts import ended_quietly
from retrolidar_ros.settings.printing import missing_library


def main() -> int:
    """Run the command; return its exit code."""
    try:
        with ended_quietly():
            from retrolidar_ros.cli.main import main as run
    except ModuleNotFoundError as error:
        print(missing_library(error), file=sys.stderr)
        return 2
    # As an exception, so that files and processes that were made for a while are ended, too.
    signal.signal(signal.SIGTERM, _exit)
    return run()


def _exit(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


if __name__ == '__main__':
    sys.exit(main())
