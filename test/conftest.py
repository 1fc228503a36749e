# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
import signal
import sys
from pathlib import Path

# Of small matrices many threads only make more work; to be said before numpy is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

# A shell lets its background jobs ignore SIGINT, and so do all that these start; but the tests
# end processes by it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Experiments are not installed. Last, so that the package that is built comes before its sources.
sys.path.append(str(Path(__file__).resolve().parents[1]))
