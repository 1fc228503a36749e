# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that ship are found, YAML is read or refused with a reason, parameters are declared."""

import math
import os
import re
import time
from inspect import signature
from pathlib import Path

import numpy as np
import pytest

from retrolidar_ros.detector.methods import MAX_PACKETS, METHODS, create_detector
from retrolidar_ros.detector.parameters import READING
from retrolidar_ros.marker.code import IDS, RESERVED_IDS
from retrolidar_ros.scene import Scene, Simulation, parse_scene
from retrolidar_ros.scene.description import find_scene, load_scene
from retrolidar_ros.sensor.model import NoiseLaw
from retrolidar_ros.sensor.serial_source import PROTOCOLS
from retrolidar_ros.settings import files
from retrolidar_ros.settings.files import load_yaml, shared_file
from retrolidar_ros.settings.parameter import declared, file_values, misspelled
from retrolidar_ros.settings.section import ConfigError

Patch = pytest.MonkeyPatch


def install(directory: Path, monkeypatch: Patch) -> None:
    """Let the package be in a directory."""
    monkeypatch.setattr(files, '_PACKAGE', directory / 'retrolidar_ros')


def test_a_source_tree_holds_its_own_files(tmp_path: Path, monkeypatch: Patch) -> None:
    root = tmp_path / 'src' / 'repository'
    install(root, monkeypatch)
    for directory in (root, tmp_path / 'share' / 'retrolidar_ros'):
        (directory / 'config').mkdir(parents=True)
        (directory / 'config' / 'driver.yaml').touch()
    assert shared_file('config/driver.yaml').is_relative_to(tmp_path / 'share')
    (root / 'package.xml').touch()
    assert shared_file('config/driver.yaml') == root / 'config' / 'driver.yaml'


@pytest.mark.parametrize(
    'packages', ['lib/python3.11/site', 'local/lib/python3.12/dist', 'lib64/python3.13/site']
)
def test_an_installation_finds_its_share(tmp_path: Path, packages: str, monkeypatch: Patch) -> None:
    installed = tmp_path / f'{packages}-packages'
    install(installed, monkeypatch)
    shared = tmp_path / 'share' / 'retrolidar_ros' / 'msg' / 'Frame.msg'
    with pytest.raises(FileNotFoundError, match=r'msg/Frame\.msg') as caught:
        shared_file('msg/Frame.msg')
    assert str(shared.parents[1]) in str(caught.value)
    for file in (installed / 'msg' / 'Frame.msg', shared):
        file.parent.mkdir(parents=True)
        file.touch()
    assert shared_file('msg/Frame.msg') == shared


SHIPPED = sorted(path.stem for path in shared_file('config/scenes').glob('*.yaml'))


@pytest.mark.parametrize('name', SHIPPED)
def test_shipped_scene_loads_and_shows_its_markers(name: str) -> None:
    scene = load_scene(name)
    assert scene.description
    assert scene.markers
    names = [marker.name for marker in scene.markers]
    assert len(set(names)) == len(names)
    ids = {marker.id for marker in scene.markers}
    assert len(ids) == len(scene.markers)
    assert not ids & set(RESERVED_IDS)
    # Each blinks in some zone by more than four standard deviations of the noise.
    recording = Simulation(scene).run(10)
    noise = scene.sensor.noise
    assert noise
    variance = noise.floor + noise.slope * recording.signal.mean(axis=0)
    blinking = recording.signal.std(axis=0) ** 2 > 4 * variance
    assert blinking.sum() >= len(scene.markers)
    assert load_scene(str(find_scene(name))) == scene
    # Its surfaces fill each zone.
    zones = range(scene.sensor.grid.zones)
    full = {zone for one in scene.surfaces for zone in (zones if one.zones is None else one.zones)}
    assert full == set(zones)
    assert {'coffee', 'drone', 'range'} <= set(SHIPPED)


def test_a_file_goes_before_a_shipped_scene(tmp_path: Path, monkeypatch: Patch) -> None:
    monkeypatch.chdir(tmp_path)
    assert find_scene('coffee').name == 'coffee.yaml'
    Path('coffee').write_text('seed: 99')
    assert load_scene('coffee') == Scene(seed=99)


@pytest.mark.parametrize('name', ['tea', '', 'no/such.yaml', '.', 'config'])
def test_a_missing_scene_lists_those_that_ship(name: str) -> None:
    with pytest.raises(FileNotFoundError, match=r'one of .*coffee, drone, .*range'):
        load_scene(name)


def test_a_scene_error_names_file_and_key(tmp_path: Path) -> None:
    file = tmp_path / 'some.yaml'
    for text, complaint in (
        ('', 'the file: needs keys with values, not None'),
        ('sensor: {period: 21}', 'sensor.period: 21 has no unit; write 21 s'),
    ):
        file.write_text(text)
        with pytest.raises(ConfigError, match=f'^{file}: {complaint}$'):
            load_scene(str(file))


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        *(
            (text, f"key '?{key}'? stands here a second time.*line {line}, ")
            for text, key, line in (
                ('seed: 1\nduration: 2 s\nseed: 3\n', 'seed', 3),
                ('sensor:\n  period: 21 ms\n  blur: 5 %\n  period: 22 ms\n', 'period', 4),
                ('markers:\n- {id: 5,\n   name: a,\n   id: 6}\n', 'id', 4),
                ('1: a\n0x1: b\n', '1', 2),
            )
        ),
        ('a: &a [1]\nb: *a', 'aliases are not read'),
        ('[' * 1500, 'RecursionError'),
        *((f'x: !!{text}', '') for text in ('timestamp foo', 'bool maybe', 'int ""', 'set [1]')),
        ('x: !!float "' + ':'.join(['59'] * 300) + '"', ''),
        ('x: !!binary "é"', ''),
        *((text, '') for text in ('[1, 2', 'a: b: c', '\t', '--- 1\n--- 2\n', '[' * 500)),
        *((f'? {key}\n: no key\n', '') for key in ('[1, 2]', '{a: b}')),
        ('a: !!python/object:os.system x', ''),
        ('a: 2026-02-30', ''),
        (b'a: \xff\xfe', ''),
    ],
    ids=lambda value: str(value)[:20],
)
def test_no_yaml_or_what_harms_is_refused(text: str | bytes, reason: str, tmp_path: Path) -> None:
    path = tmp_path / 'hostile.yaml'
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    said = re.compile(f'^{path} is not a YAML file: .*{reason}', re.DOTALL)
    began = time.process_time()
    with pytest.raises(ValueError, match=said):
        load_yaml(path)
    assert time.process_time() - began < 2.0
    with pytest.raises(ConfigError, match=said):
        load_scene(str(path))


def test_what_never_ends_is_read_to_the_limit_and_no_file_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r'^/dev/zero is larger than the 1048576 bytes'):
        load_yaml(Path('/dev/zero'))
    fifo = tmp_path / 'fifo'
    os.mkfifo(fifo)
    with pytest.raises(ValueError, match=f'^{fifo} is a FIFO; give a regular file$'):
        load_yaml(fifo)
    with pytest.raises(IsADirectoryError, match=f'^{tmp_path} cannot be read: Is a directory$'):
        load_yaml(tmp_path)
    with pytest.raises(FileNotFoundError):
        load_yaml(tmp_path / 'missing.yaml')


def test_so_many_markers_make_no_scene() -> None:
    marker = {'id': 7, 'position': ['0 m', '0 m', '1 m']}
    with pytest.raises(ConfigError, match='markers: 5000 of them; 256 are the most'):
        parse_scene({'markers': [marker] * 5000})


def test_noise_in_a_file_is_read_or_refused(tmp_path: Path) -> None:
    """Nothing but ValueError, for hundreds of damaged files."""
    whole = b'markers:\n  2073: {frame: &f beans, note: !!str x, size: 3 cm}\n  <<: {7: [1, *f]}\n'
    alphabet = np.frombuffer(b'!&*<>:[]{}"\'\n -?|%@`\t0x\xff\0' + whole, np.uint8)
    rng = np.random.default_rng(4)
    path, refused = tmp_path / 'noise.yaml', 0
    for _ in range(500):
        data = np.frombuffer(whole, np.uint8).copy()
        data[rng.integers(0, len(data), 6)] = rng.choice(alphabet, 6)
        path.write_bytes(data.tobytes())
        try:
            load_yaml(path)
        except ValueError:
            refused += 1
        with pytest.raises(ConfigError, match=f'^{path}'):
            load_scene(str(path))
    assert 150 < refused < 500


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


def test_the_parameters_for_the_lifecycle_manager_of_nav2_name_the_driver() -> None:
    parameters = {'node_names': ['driver'], 'autostart': True, 'bond_timeout': 0.0}
    found = load_yaml(shared_file('config/nav2.yaml'))
    assert found == {'/**/lifecycle_manager': {'ros__parameters': parameters}}
    # A whole number would be of another type, which nav2 refuses.
    (section,) = found.values()
    assert isinstance(section['ros__parameters']['bond_timeout'], float)


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


@pytest.mark.parametrize(
    ('section', 'nodes'),
    [
        ('/**', {'/detector', '/left/detector', '/hall/left/detector', '/left/driver'}),
        ('/**/detector', {'/detector', '/left/detector', '/hall/left/detector'}),
        ('/*/detector', {'/left/detector'}),
        ('/left/*', {'/left/detector', '/left/driver'}),
        ('/hall/**', {'/hall/left/detector'}),
        ('/left/detector', {'/left/detector'}),
        ('detector', {'/detector'}),
    ],
)
def test_a_section_is_of_the_nodes_of_its_name(
    section: str, nodes: set[str], tmp_path: Path
) -> None:
    path = tmp_path / 'parameters.yaml'
    path.write_text(f"'{section}': {{ros__parameters: {{frame_prefix: a/}}}}")
    names = ('/detector', '/left/detector', '/hall/left/detector', '/left/driver')
    found = {name for name in names if file_values(path, name.rpartition('/')[2], name)}
    assert found == nodes


def test_only_what_is_nearly_a_node_is_called_misspelled() -> None:
    others = ('/**', '/**/detector', '/leader', '/apriltag_detector', '/**/lifecycle_manager')
    assert misspelled(others) == []
    (hint,) = misspelled(['/**/landmark', *others])
    assert hint == '/**/landmark is none of these nodes; did you mean landmarks?'
