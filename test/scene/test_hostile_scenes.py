# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whatever a scene file holds is refused by name, or can be simulated."""

import copy
from typing import Any

import numpy as np
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from test_scene_description import FULL, KEYS, LEAVES, QUANTITIES, at, dotted, outcome, with_value

from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.sensor.wire import encode_frame
from retrolidar_ros.settings.section import UNITS

NUMBERS = st.one_of(
    st.integers(-3, 70), st.floats(), st.sampled_from([0.0, 1e-3, 1e9, 1e-300, 1e300, 4096])
)
UNIT_NAMES = [unit for units in UNITS.values() for unit in units]
AMOUNTS = st.builds(lambda number, unit: f'{number} {unit}', NUMBERS, st.sampled_from(UNIT_NAMES))
SCALARS = (
    st.none() | st.booleans() | NUMBERS | AMOUNTS | st.text(max_size=5) | st.binary(max_size=3)
)
NAMES = st.sampled_from(sorted({str(path[-1]) for path in KEYS}))
KEY_NAMES = NAMES | st.text(max_size=3) | st.integers() | st.none() | st.floats()
CONTENTS = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(KEY_NAMES, inner, max_size=6),
    max_leaves=20,
)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.dictionaries(NAMES, CONTENTS, max_size=4) | CONTENTS)
def test_whatever_is_no_scene_is_a_scene_error(content: Any) -> None:
    assert outcome(content)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.data())
def test_a_damaged_scene_is_refused_by_the_name_of_its_key(data: st.DataObject) -> None:
    path = data.draw(st.sampled_from([*KEYS, *(path for path, _ in LEAVES)]))
    result = outcome(with_value(path, data.draw(CONTENTS)))
    if isinstance(result, str):
        assert result.startswith((dotted(path), 'surfaces[0].zones', dotted(path[:-1])))


@settings(
    max_examples=50,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.filter_too_much],
)
@given(st.data())
def test_an_accepted_scene_gives_frames_for_the_wire(data: st.DataObject) -> None:
    content = copy.deepcopy(FULL)
    for path, value in data.draw(st.lists(st.sampled_from(QUANTITIES), min_size=1, max_size=4)):
        # Round numbers over the whole of the allowed range, and its ends.
        exponent = data.draw(st.integers(-6, 9))
        number = data.draw(st.sampled_from([f'1e{exponent}', f'-1e{exponent}', '0']))
        at(content, path[:-1])[path[-1]] = f'{number} {value.split(" ")[1]}'
    scene = outcome(content)
    assume(isinstance(scene, Scene))
    assert isinstance(scene, Scene)
    recording = Simulation(scene).advance(12)
    assert (recording.signal >= 0).all()
    assert (np.isnan(recording.distance) == (recording.status == 255)).all()
    for frame in recording:
        assert encode_frame(frame)
