# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`config/retrolidar.yaml` as the declaration of all parameters."""

import math
import re
from inspect import signature

import pytest

from retrolidar_ros.detector.methods import MAX_PACKETS, METHODS, create_detector
from retrolidar_ros.detector.parameters import READING
from retrolidar_ros.marker.code import IDS
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.sensor.protocols import PROTOCOLS
from retrolidar_ros.settings.parameter import declared


def test_the_parameter_file_and_the_library_have_the_same_defaults_and_limits() -> None:
    detector, driver = declared()['detector'], declared()['driver']
    library = signature(create_detector).parameters
    assert detector['bit_period'].default == library['bit_period_s'].default
    for name in ('likelihood_threshold', 'false_ids_per_hour', 'max_packets'):
        assert detector[name].default == library[name].default
    names = ('noise_floor', 'noise_slope', 'noise_ambient')
    assert NoiseLaw(*(detector[name].default for name in names)) == NoiseLaw()
    assert detector['max_packets'].limits == (1, MAX_PACKETS)
    assert detector['registered_ids'].limits == (0, IDS - 1)
    assert detector['method'].among == METHODS
    assert driver['protocol'].among == tuple(PROTOCOLS)
    assert set(READING) < set(detector)


def test_every_parameter_is_described_and_has_limits_that_its_default_keeps() -> None:
    for node, parameters in declared().items():
        for name, one in parameters.items():
            assert one.check(name, one.default) == one.default, node
            assert re.fullmatch(r'[A-Z].*[.]', one.description), (node, name)
            kind = type(one.default)
            assert bool(one.limits) == (kind in (int, float) or name == 'registered_ids')
            assert not re.search(r'Range:|One of:|Live', one.description), one.description


@pytest.mark.parametrize(
    ('name', 'value', 'reason'),
    [
        ('method', 'magic', "'magic' is not one of joint, paper"),
        ('max_packets', 9, '9 is not within 1 to 8'),
        ('max_packets', 2.0, '2.0 is not of type int'),
        ('max_packets', True, 'True is not of type int'),
        ('noise_floor', math.nan, 'nan is not within 1e-06 to 1000000'),
        ('publish_tf', 1, '1 is not of type bool'),
        ('registered_ids', [7, 5000], '5000 is not within 0 to 4095'),
        ('registered_ids', 7, '7 is not a list'),
        ('registered_ids', [True], 'True is not a whole number'),
        ('registered_ids', [1] * 200_000, '200000 numbers; 4096 are the most'),
    ],
)
def test_what_is_not_allowed_is_refused(name: str, value: object, reason: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f'{name}: {reason}')):
        declared()['detector'][name].check(name, value)


def test_a_whole_number_may_be_a_float_and_texts_are_not_empty() -> None:
    checked = declared()['detector']['bit_period'].check('bit_period', 1)
    assert (checked, type(checked)) == (1.0, float)
    with pytest.raises(ValueError, match="topics: '' is not a text"):
        declared()['landmarks']['topics'].check('topics', ['a', ''])
