# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which readings are kept where more come than can be solved."""

from __future__ import annotations

import numpy as np
from harness_readings import HERE, SQUARE, seen

from retrolidar_ros.tasks.backlog import Backlog


def test_who_waits_longest_is_next_with_the_newest_of_its_readings() -> None:
    rng = np.random.default_rng(1)
    backlog = Backlog()
    for index in range(30):
        for name in ('mug', 'jar')[index > 0 :]:
            backlog.add(name, seen(HERE, SQUARE[0], rng, stamp_s=index), now_s=0.1 * index)
    assert backlog.dropped == 22
    assert len(backlog) == 9
    mug, jar = backlog.pop(), backlog.pop()
    assert (mug.name, [one.stamp_s for one in mug.readings]) == ('mug', [0])
    assert (jar.name, [one.stamp_s for one in jar.readings]) == ('jar', list(range(22, 30)))
    assert jar.since_s == 0.0
    assert not backlog
