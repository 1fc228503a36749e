# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Call a function in a new process with a changed core, as a process keeps its first one."""

import json
import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from evaluation.bench.core_parts import Part, use_core_with


def call_with(changes: Sequence[Part], function: str, *arguments: Any) -> Any:
    """Return what a function returns by a core with some lines changed.

    The function is named as MODULE.NAME; arguments and result are fit for JSON.
    """
    command = [sys.executable, '-m', 'evaluation.bench.core_process']
    request = json.dumps([changes, function, arguments])
    pipes: dict[str, Any] = {'input': request, 'stdout': subprocess.PIPE, 'text': True}
    return json.loads(subprocess.run(command, check=True, **pipes).stdout)


def _main() -> None:
    changes, function, arguments = json.load(sys.stdin)
    use_core_with([Part(*one) for one in changes])
    module, _, name = function.rpartition('.')
    print(json.dumps(getattr(import_module(module), name)(*arguments)))


if __name__ == '__main__':
    _main()
