# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`make evaluate`: run experiments and draw their charts."""

import os
import sys

if __name__ == '__main__':
    # Started in the checkout, Python looks there first; but the built package has the messages.
    sys.path.append(sys.path.pop(0))
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

    from evaluation.command import main

    sys.exit(main())
