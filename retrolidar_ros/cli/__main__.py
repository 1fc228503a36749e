# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Entry point of the command: handles signals before the slow imports."""

import signal
import sys

from retrolidar_ros.settings.interrupts import ended_quietly, exit_by, handle

_DISTRIBUTIONS = {'serial': 'pyserial', 'yaml': 'pyyaml'}  # of libraries with another name


def main() -> int:
    """Run the command; return its exit code."""
    try:
        with ended_quietly():
            from retrolidar_ros.cli.main import main as run
        handle(exit_by, [signal.SIGTERM])
        return run()
    except ModuleNotFoundError as error:
        name = str(error.name).partition('.')[0]
        name = _DISTRIBUTIONS.get(name, name)
        print(f'retrolidar: a library is missing: pip install {name}', file=sys.stderr)
        return 2


if __name__ == '__main__':
    sys.exit(main())
