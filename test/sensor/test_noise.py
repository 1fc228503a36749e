# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The law of the sensor's noise."""

import numpy as np
import pytest

from retrolidar_ros.sensor.noise import NoiseLaw

LAW = NoiseLaw()


@pytest.mark.parametrize(
    ('floor', 'slope'), [(0.0, 0.2), (-1.0, 0.2), (1.0, -0.1), (np.nan, 0.2), (1.0, np.nan)]
)
def test_a_law_that_allows_no_noise_is_refused(floor: float, slope: float) -> None:
    with pytest.raises(ValueError, match='the floor must be positive'):
        NoiseLaw(floor, slope)


def test_ambient_light_raises_the_floor() -> None:
    assert LAW.lit(10.0).variance(np.array(0.0)) == pytest.approx(LAW.floor + 10 * LAW.ambient)
    assert LAW.lit(10.0).slope == LAW.slope
    assert LAW.lit([3.0, np.nan, np.inf, -5.0]).floor == LAW.floor + 0.75 * LAW.ambient
