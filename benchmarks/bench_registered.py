# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many markers that are not registered are read as one that is, over the link.

embedded/run python benchmarks/bench_registered.py

What registered IDs give is evaluated by `speed-accuracy`; what is read of them where no marker is,
the experiment `roc` counts.
"""

from __future__ import annotations

import numpy as np

from evaluation.bench.recordings import record
from evaluation.bench.stresses import PLAIN
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.dictionary import choose_ids
from retrolidar_ros.scene.marker_budget import needed_swing
from retrolidar_ros.scene.reference import SENSOR

COUNTS = (64, 3)
SCENES = 6
LINKS_DB = (6.0, 8.0, 10.0, 14.0, 20.0)


def main() -> None:
    """Print how many packets of strangers are read."""
    rng = np.random.default_rng(1)
    for snr_db in LINKS_DB:
        misread = dict.fromkeys(COUNTS, 0)
        for _ in range(SCENES):
            sent = record(PLAIN, needed_swing(snr_db), rng)
            for count in COUNTS:
                absent = np.setdiff1d(choose_ids(count)[0], sent.ids).tolist()
                detector = create_detector('joint', SENSOR.grid, registered_ids=absent)
                misread[count] += len(detector.update_all(sent.recording))
        told = ', '.join(f'{wrong} with {count} registered' for count, wrong in misread.items())
        print(f'{snr_db:4.0f} dB: of {SCENES * SENSOR.grid.zones} strangers {told}')


if __name__ == '__main__':
    main()
