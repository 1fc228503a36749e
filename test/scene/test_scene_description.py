# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every key of a scene: what is read of it, and what is refused by its name."""

import copy
import math
import re
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from retrolidar_ros.scene import Scene, Simulation, parse_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.wire import encode_frame
from retrolidar_ros.settings.section import UNITS, ConfigError, quantity

# Every key there is, none at its default.
FILE = Path(__file__).with_name('every_key.yaml')
FULL: dict[str, Any] = yaml.safe_load(FILE.read_text(encoding='utf-8'))
SIZES = {'s': 1, 'ms': 1e-3, 'us': 1e-6, 'm': 1, 'cm': 1e-2, 'mm': 1e-3, 'deg': math.pi / 180}
SIZES |= {'%': 1e-2, 'kcps/SPAD': 1, '(kcps/SPAD)^2': 1}

Place = tuple[str | int, ...]


def nodes(content: Any, path: Place = ()) -> Iterator[tuple[Place, Any]]:
    """Yield all that is in a tree of mappings and lists, and where."""
    yield path, content
    if isinstance(content, dict | list | tuple):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in pairs:
            yield from nodes(value, (*path, key))


def leaves(content: Any) -> dict[Place, Any]:
    return {path: one for path, one in nodes(content) if not isinstance(one, dict | list | tuple)}


def dotted(path: Place) -> str:
    return ''.join(f'[{p}]' if isinstance(p, int) else f'.{p}' for p in path).lstrip('.')


def at(content: Any, path: Place) -> Any:
    for part in path:
        content = content[part]
    return content


def with_value(path: Place, value: Any) -> Any:
    content = [copy.deepcopy(FULL)]
    at(content, (0, *path)[:-1])[(0, *path)[-1]] = value
    return content[0]


def outcome(content: Any) -> Scene | str:
    """Return the scene, or the message of its refusal."""
    try:
        return parse_scene(content)
    except ConfigError as error:
        return str(error)


def refusal(content: Any) -> str:
    message = outcome(content)
    assert isinstance(message, str)
    return message


LEAVES = leaves(FULL)
SECTIONS = [path for path, one in nodes(FULL) if isinstance(one, dict)]
KEYS = [path for path, _ in nodes(FULL) if path and isinstance(path[-1], str)]
QUANTITIES = [(path, value) for path, value in LEAVES.items() if re.match(r'-?[\d.]+ ', str(value))]
ITEMS = ('id', 'position', 'distance', 'signal', 'width', 'path', 'time')
NEEDED = {(index, key) for index in (0, 1) for key in ITEMS} | {
    (section, key)
    for section, keys in {
        'noise': 'floor slope',
        'ranging': 'shot floor',
        'response': 'dark bright',
        'wander': 'across along period',
        'occlusion': 'every lasting',
        'second_sensor': 'ambient period lasting',
    }.items()
    for key in keys.split()
}
COMPLETE = parse_scene(FULL)


def test_every_key_is_read() -> None:
    assert len(QUANTITIES) == 66
    read = {
        tuple(re.sub('(?<!_1)_(s|m|rad)$', '', p) if isinstance(p, str) else p for p in path): value
        for path, value in leaves(asdict(COMPLETE)).items()
    }
    for name in ('rows', 'columns', 'view'):
        assert read.pop(('sensor', 'grid', name)) == getattr(ZoneGrid(8, 8), name)
    expected = LEAVES.copy()
    assert expected.pop(('sensor', 'zones')) == '8x8'
    for path, text in QUANTITIES:
        number, unit = text.split(' ')
        expected[path] = pytest.approx(float(number) * SIZES[unit])
    assert read == expected


@pytest.mark.parametrize('path', KEYS, ids=dotted)
def test_every_key_can_be_left_out_or_is_said_to_be_missing(path: Place) -> None:
    content = copy.deepcopy(FULL)
    del at(content, path[:-1])[path[-1]]
    if path == ('sensor',) or path == ('sensor', 'zones'):
        content['surfaces'] = []  # zone 63 would be too many
    result = outcome(content)
    # A marker needs either.
    either = ('markers', 0, 'position'), ('markers', 0, 'path')
    if path[-2:] in NEEDED and path not in either:
        assert result == f'{dotted(path)}: is missing'
    else:
        assert isinstance(result, Scene)
        assert result != COMPLETE


@pytest.mark.parametrize('path', SECTIONS, ids=dotted)
def test_unknown_key_is_named(path: Place) -> None:
    message = refusal(with_value((*path, 'zzz'), 'red'))
    assert message.startswith(f'{dotted((*path, "zzz"))}: unknown key; known are ')
    assert all(str(key) in message for key in at(FULL, path))
    mistyped = next(iter(at(FULL, path)))
    assert refusal(with_value((*path, f'{mistyped}s'), 1)).endswith(f'did you mean {mistyped}?')


@pytest.mark.parametrize(
    ('path', 'value'), QUANTITIES, ids=[dotted(path) for path, _ in QUANTITIES]
)
def test_quantity_needs_its_unit(path: Place, value: str) -> None:
    number, unit = value.split(' ')
    known = next(units for units in UNITS.values() if unit in units)
    # A number may have been read as such by YAML already.
    for lacking in (number, float(number)):
        message = refusal(with_value(path, lacking))
        assert re.match(f'{re.escape(dotted(path))}: .* has no unit; write {lacking} ', message)
        # What the message says to write is of the right kind, if perhaps of another size.
        assert message.rsplit(' ', 1)[1] in known
    message = refusal(with_value(path, f'{number} furlong'))
    assert message.startswith(f'{dotted(path)}: ')
    assert f'is in furlong; it needs {" or ".join(known)}' in message


@pytest.mark.parametrize(
    ('key', 'limits'),
    [
        ('seed', {-1: '0 to ', 2**63: '0 to '}),
        ('duration', {'0 s': 'at least 0.1', '1e400 s': 'at most 1e+09'}),
        ('sensor.zones', {'4x8': 'is not 4x4 or 8x8', (4, 4): 'is not 4x4 or 8x8'}),
        ('sensor.period', {'-21 ms': 'at least 1', '11 s': 'at most 10'}),
        ('sensor.lost', {'100 %': 'at most 99'}),
        ('markers.0.id', {4096: '0 to 4095', -1: '0 to 4095'}),
        ('markers.0.position', {('0 m', '0 m'): 'needs x, y and z, not 2 values'}),
        (
            'markers.0.position',
            {('0 m', '0 m', z): 'at least 0.001 m' for z in ('0 m', '-1 m', '1e-300 m')},
        ),
        ('markers.0.packets', {0: '1 to '}),
        ('markers.0.wander.along', {'130 cm': 'would reach the sensor'}),
        ('markers.0.occlusion.lasting', {'1.7 s': 'never be seen'}),
        ('surfaces.0.signal', {'-1 kcps/SPAD': 'at least 0', '1e300 kcps/SPAD': 'at most 1e+09'}),
        ('surfaces.0.zones.0', {64: '0 to 63'}),
    ],
)
def test_impossible_values_name_key_and_limit(key: str, limits: dict[Any, str]) -> None:
    path = tuple(int(part) if part.isdigit() else part for part in key.split('.'))
    for value, hint in limits.items():
        message = refusal(with_value(path, list(value) if isinstance(value, tuple) else value))
        assert message.startswith(dotted(path))
        assert hint in message


def test_jitter_lets_none_overtake() -> None:
    def with_jitter(jitter: str, error: str = '0 %') -> dict[str, Any]:
        return {'sensor': {'jitter': jitter, 'period': '10 ms', 'period_error': error}}

    for possible in (with_jitter('2.4 ms'), with_jitter('2.5 ms', '1 %')):
        times = Simulation(parse_scene(possible)).advance(2000).sensor_time_us
        assert np.diff(times).min() > 0
    for impossible in (with_jitter('2.5 ms'), with_jitter('2.4 ms', '-5 %')):
        assert refusal(impossible).startswith('sensor.jitter: frames would overtake')


def test_what_depends_on_another_key() -> None:
    surfaces = [{'distance': '1 m', 'signal': '1 kcps/SPAD', 'zones': [16]}]
    assert refusal({'surfaces': surfaces}).startswith('surfaces[0].zones[0]: ')
    large = parse_scene({'surfaces': surfaces, 'sensor': {'zones': '8x8'}})
    assert large.surfaces[0].zones == (16,)
    for key in ('dark', 'bright'):
        marker: dict[str, Any] = {'id': 9, 'position': ['0 m', '0 m', '1 m']}
        marker['response'] = {'dark': '1 ms', 'bright': '1 ms', key: '22 ms'}
        assert refusal({'markers': [marker]}).startswith('markers[0].response: too slow')
        assert parse_scene({'markers': [{**marker, 'bit_period': '44 ms'}]}).markers


def test_forms_of_a_quantity() -> None:
    forms = {'21 ms': 0.021, '21ms': 0.021, ' 2.1e1  ms ': 0.021, '+.5 s': 0.5, '5. us': 5e-6}
    for text, seconds in forms.items():
        assert quantity('time')(text, 'key') == pytest.approx(seconds)
    for text in ('ms', '1,5 ms', '0x10 ms', '1 m s', 'nan s', 'inf s', '- 5 ms', '.'):
        with pytest.raises(ConfigError, match=r'^key: .*s or ms or us'):
            quantity('time')(text, 'key')


def test_a_marker_on_a_path_is_where_its_waypoints_say() -> None:
    path = [
        {'time': '0 s', 'position': ['0 m', '0 m', '1 m']},
        {'time': '2 s', 'position': ['40 cm', '0 m', '1 m']},
    ]
    (marker,) = parse_scene({'markers': [{'id': 7, 'path': path}]}).markers
    assert marker.position_m == (0, 0, 1)
    places = position_at(marker, np.array([0.0, 0.5, 1.0, 2.5]))
    assert places[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.1])
    with pytest.raises(ConfigError, match=r'markers\[0\].position: is missing'):
        parse_scene({'markers': [{'id': 7}]})
    path[1]['position'] = ['0 m', '0 m', '0 m']
    with pytest.raises(ConfigError, match=r'path\[1\].position: z of 0 m is impossible'):
        parse_scene({'markers': [{'id': 7, 'path': path}]})


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


@given(st.dictionaries(NAMES, CONTENTS, max_size=4) | CONTENTS)
def test_whatever_is_no_scene_is_a_scene_error(content: Any) -> None:
    result = outcome(content)
    if isinstance(result, str):
        named = content if isinstance(content, dict) else ['the file']
        assert result.startswith(tuple(map(str, named)))
    else:
        assert {*content} <= {*FULL}


@given(st.data())
def test_a_damaged_scene_is_refused_by_the_name_of_its_key(data: st.DataObject) -> None:
    path = data.draw(st.sampled_from([*KEYS, *LEAVES]))
    result = outcome(with_value(path, data.draw(CONTENTS)))
    if isinstance(result, str):
        # Or what holds it, or what depends on it.
        named = [dotted(one) for one in (path, path[:-1]) if one]
        assert result.startswith((*named, 'surfaces[0].zones'))


@settings(suppress_health_check=[HealthCheck.filter_too_much])
@given(st.data())
def test_an_accepted_scene_gives_frames_for_the_wire(data: st.DataObject) -> None:
    content = copy.deepcopy(FULL)
    for path, value in data.draw(st.lists(st.sampled_from(QUANTITIES), min_size=1, max_size=4)):
        # Round numbers over the whole of the allowed range, and its ends.
        exponent = data.draw(st.integers(-6, 9))
        number = data.draw(st.sampled_from([f'1e{exponent}', f'-1e{exponent}', '0']))
        at(content, path[:-1])[path[-1]] = f'{number} {value.split(" ")[1]}'
    scene = outcome(content)
    if isinstance(scene, str):
        reject()
    recording = Simulation(scene).advance(12)
    assert (recording.signal >= 0).all()
    assert (np.isnan(recording.distance) == (recording.status == 255)).all()
    for frame in recording:
        assert encode_frame(frame)
