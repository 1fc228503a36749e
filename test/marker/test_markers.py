# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from retrolidar_ros.marker.code import IDS
from retrolidar_ros.marker.known_markers import (
    KnownMarker,
    frame_of,
    load_markers,
    objects_of,
    parse_markers,
)
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.settings.files import shared_file
from retrolidar_ros.settings.section import ConfigError

ids = st.integers(1, IDS - 2)
frames = st.text('azAZ09_.-/', min_size=1, max_size=9).filter(lambda name: name[0] != '/')


def test_a_marker_says_its_frame_note_and_place_or_has_defaults() -> None:
    said = {'frame': 'mug', 'note': 'on the table'}
    known = parse_markers({'markers': {5: said, 8: {}}})
    assert known[5] == KnownMarker(5, 'mug', 'on the table')
    assert known[8] == KnownMarker(8, 'marker_8', '')
    assert parse_markers({'markers': {}}) == {}
    assert parse_markers({'markers': {5: {'frame': 'marker_5'}}})[5].frame == 'marker_5'
    tray = {'object': 'tray', 'place': ['10 cm', '-5 mm', '0 m']}
    objects = objects_of(parse_markers({'markers': {5: tray, 6: {}}}))
    assert {name: [*places] for name, places in objects.items()} == {'tray': [5]}
    assert objects['tray'][5].tolist() == [0.1, -0.005, 0.0]


@given(
    st.dictionaries(ids, frames, max_size=5).filter(lambda d: len(set(d.values())) == len(d)), ids
)
def test_every_id_and_frame_that_can_be_is_taken(content: dict[int, str], other: int) -> None:
    known = parse_markers({'markers': {one: {'frame': name} for one, name in content.items()}})
    assert {one: marker.frame for one, marker in known.items()} == content
    assert all(marker.id == one for one, marker in known.items())
    # An unknown marker is called by its ID.
    for one in (*content, other):
        assert frame_of(one, known) == content.get(one, f'marker_{one}')


FIELDS = [
    *(
        ('frame', name, f'{name!r} cannot be a TF frame; letters, digits and _ . - / within')
        for name in ('/x', 'a b', 'a\n', 'ü', '{name}', '/')
    ),
    ('object', 'x' * 300, 'a name of 300 characters is too long; 100 are the most'),
    *(('note', value, f'{value!r} is not a text') for value in ('', None, ['a'])),
    ('frames', 'x', 'unknown key; did you mean frame?'),
    ('size', '3 cm', 'unknown key; known are frame, note, object, place'),
    ('place', ['1 m'], 'needs x, y and z, not 1 values'),
    *(
        ('frame', f'marker_{other}', f'marker_{other} is what marker {other} is called')
        for other in (6, 77)
    ),
]


@pytest.mark.parametrize(
    ('markers', 'complaint'),
    [
        *(
            ({7: {}, one: {}}, f': {one!r} is not an ID; numbers of 1 to 4094 are')
            for one in (0, 4095, -1, True, 'a', 5.0, None)
        ),
        (None, ': needs a mapping of IDs to markers, not None'),
        *(({5: one}, f'.5: needs keys with values, not {one!r}') for one in (None, 'mug', ['f'])),
        ({5: {'frame': 'mug'}, 6: {'frame': 'mug'}}, '.6.frame: marker 5 has the frame mug, too'),
        *(({5: {key: value}}, f'.5.{key}: {complaint}') for key, value, complaint in FIELDS),
    ],
)
def test_what_cannot_be_known_is_refused_by_its_key(markers: object, complaint: str) -> None:
    with pytest.raises(ConfigError, match=f'^{re.escape(f"markers{complaint}")}$'):
        parse_markers({'markers': markers})


def test_a_file_may_write_an_id_in_any_base_but_once(tmp_path: Path) -> None:
    file = tmp_path / 'some.yaml'
    with pytest.raises(FileNotFoundError):
        load_markers(file)
    file.write_text('markers:\n  0x819: {frame: beans}\n  2096: {note: mug}\n')
    assert load_markers(file) == {
        2073: KnownMarker(2073, 'beans'),
        2096: KnownMarker(2096, 'marker_2096', 'mug'),
    }
    file.write_text('markers:\n  0x819: {}\n  2073: {}\n')
    with pytest.raises(ConfigError, match='key 2073 stands here a second time'):
        load_markers(file)


def test_the_shipped_file_names_the_markers_of_the_shipped_scenes() -> None:
    known = load_markers(shared_file('config/markers.yaml'))
    scenes = {one.id: one.name for name in ('coffee', 'drone') for one in load_scene(name).markers}
    assert {one: marker.frame for one, marker in known.items()} == scenes
    for marker in known.values():
        assert marker.note
