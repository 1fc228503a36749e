# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""`calibrate`, and `decode` that names what does not fit."""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip('rosbags', reason='bags are written with rosbags')

from retrolidar_ros.cli.main import main
from retrolidar_ros.detector.parameters import load_parameters
from retrolidar_ros.scene import parse_scene
from retrolidar_ros.scene.emulator import record

Output = pytest.CaptureFixture[str]
NOISE = {'floor': '4.6 (kcps/SPAD)^2', 'slope': '0.22 kcps/SPAD'}
MARKER = {'id': 2816, 'position': ['0.1 m', '0.1 m', '0.9 m'], 'bit_period': '42 ms'}
WALL = {'distance': '0.95 m', 'signal': '10 kcps/SPAD'}
SENSOR: dict[str, Any] = {'jitter': '1 ms', 'noise': NOISE}


def bag_of(path: Path, seconds: float = 12.0, **content: Any) -> str:
    scene = {'sensor': SENSOR, 'markers': [MARKER], 'surfaces': [WALL], **content}
    record(parse_scene(scene), path / 'bag', 'mcap', seconds)
    return str(path / 'bag')


def test_a_bag_without_markers_is_an_exit_code_of_its_own(tmp_path: Path, capsys: Output) -> None:
    bag = bag_of(tmp_path, markers=[])
    assert main(['calibrate', bag, '-o', str(tmp_path / 'out')]) == 3
    assert 'Next: No zone blinks' in capsys.readouterr().out
    values = yaml.safe_load((tmp_path / 'out' / 'calibration.yaml').read_text())
    assert 'bit_period' not in values['/**/detector']['ros__parameters']


FAINT = {**MARKER, 'position': ['0.29 m', '0.29 m', '2.8 m']}
NEAR = {**MARKER, 'position': ['0.03 m', '0.03 m', '0.25 m'], 'contrast': '90 %'}
LOUD = {'floor': '74 (kcps/SPAD)^2', 'slope': '3.5 kcps/SPAD'}
NEIGHBOUR = {'ambient': '30 kcps/SPAD', 'period': '33 ms', 'lasting': '11 ms'}
HAND = {
    'width': '30 cm',
    'signal': '60 kcps/SPAD',
    'path': [
        {'time': '0 s', 'position': ['-0.2 m', '0 m', '0.5 m']},
        {'time': '0.9 s', 'position': ['0.2 m', '0.1 m', '0.6 m']},
        {'time': '1.7 s', 'position': ['-0.2 m', '0 m', '0.5 m']},
    ],
}


@pytest.mark.parametrize(
    ('content', 'sentence'),
    [
        ({'sensor': {**SENSOR, 'period': '33.3 ms'}, 'markers': [FAINT]}, 'two are read farther'),
        ({'markers': [{**MARKER, 'contrast': '1 %'}]}, 'check polarisers and voltage'),
        (
            {'sensor': {**SENSOR, 'saturation': '40 kcps/SPAD'}, 'markers': [NEAR], 'surfaces': []},
            'farther away if so much light saturates the sensor',
        ),
        ({'sensor': {**SENSOR, 'abnormal': '70 %'}}, 'shade it from the sun, clean the window'),
        (
            {'sensor': {**SENSOR, 'noise': LOUD}, 'markers': [FAINT]},
            'run `retrolidar calibrate BAG`',
        ),
        ({'sensor': {**SENSOR, 'crosstalk': '900 kcps/SPAD'}}, 'such as a cover glass'),
        (
            {'sensor': {**SENSOR, 'second_sensor': NEIGHBOUR}, 'markers': []},
            'another sensor shines into the view',
        ),
        ({'markers': [], 'moving_surfaces': [HAND]}, 'without a bit clock: something moves'),
    ],
)
def test_a_mismatch_is_named_with_its_remedy(
    content: dict[str, Any], sentence: str, tmp_path: Path, capsys: Output
) -> None:
    assert main(['decode', bag_of(tmp_path, 5, **content)]) in (0, 3)
    printed = capsys.readouterr().err
    assert sentence in printed
    assert all(len(line) < 200 for line in printed.splitlines())


def test_options_and_explanations(tmp_path: Path, capsys: Output) -> None:
    bag = bag_of(tmp_path, 6)
    assert main(['decode', bag, '--registered-ids', '5,6', '--explain']) == 3
    said = capsys.readouterr().err
    assert 'ID 2816 would be read if registered_ids held it' in said
    header, row, *_, asked = said.splitlines()[-3:]
    assert header.startswith('zone  blinks [dB]  bits [ms]')
    assert row.split()[0] == '10'
    assert asked.startswith('thresholds [nats]: evidence ≥ 18.4')
    ranges_m = []
    for options in ([], ['--range-offset', '0.02']):
        assert main(['decode', bag, *options]) == 0
        ranges_m.append(float(capsys.readouterr().out.splitlines()[1].split()[2]))
    assert ranges_m[0] - ranges_m[1] == pytest.approx(0.02, abs=1e-3)


def test_a_table_has_its_header_if_two_are_read_at_once(tmp_path: Path, capsys: Output) -> None:
    both = [MARKER, {**MARKER, 'id': 2073, 'position': ['-0.1 m', '-0.1 m', '0.9 m']}]
    assert main(['decode', bag_of(tmp_path, 2, markers=both)]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split()[:2] == ['stamp', '[s]']
    assert {row.split()[1] for row in rows} == {'2816', '2073'}


def test_a_marker_that_is_read_too_seldom_is_named(tmp_path: Path, capsys: Output) -> None:
    hidden = {**MARKER, 'occlusion': {'every': '6 s', 'lasting': '4 s'}}
    assert main(['decode', bag_of(tmp_path, 30, markers=[hidden])]) == 0
    said = capsys.readouterr().err
    assert re.search(r'ID 2816 was read in \d packets of 23', said), said


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('/**/detector: {ros__parameters: {bitperiod: 1}}', 'bitperiod: no such parameter'),
        ('/**/detector: {ros__parameters: {bit_period: x}}', "'x' is not of type float"),
        ('/**/detector: {ros__parameters: {bit_period: 99.0}}', '99.0 is not within 0.002 to 10'),
        ('/**/detector: {bit_period: 1}', 'has no ros__parameters'),
        ('[]', 'is no parameter file'),
        ('# ros__parameters', 'is no parameter file'),
        ('{markers: {id: 1}}', 'is no parameter file'),
        ('/**/detector: {ros__parameters: [1]}', 'ros__parameters are no names with values'),
        ('/**/detector: {ros__parameters: {1: 2}}', '1: no such parameter'),
        ('/**/driver: {ros__parameters: {}}', 'no section is for a detector; call it /**/detector'),
        (
            '/**/detecter: {ros__parameters: {}}',
            '/**/detecter is none of these nodes; did you mean detector',
        ),
        (
            '{/a/detector: {ros__parameters: {}}, /b/detector: {ros__parameters: {}}}',
            '/a/detector, /b/detector are of several nodes; leave one of them',
        ),
    ],
)
def test_bad_parameters_are_named(text: str, message: str, tmp_path: Path, capsys: Output) -> None:
    (tmp_path / 'p.yaml').write_text(text)
    bag = bag_of(tmp_path, 1)
    assert main(['decode', bag, '--params', str(tmp_path / 'p.yaml')]) == 2
    assert message in capsys.readouterr().err


def test_what_nodes_accept_the_command_accepts(tmp_path: Path) -> None:
    """ROS's own parameters, and what `/**` says of other nodes."""
    qos = 'qos_overrides./retrolidar/frames.subscription: {depth: 9}'
    shared = f'/**: {{ros__parameters: {{use_sim_time: true, {qos}, serial_port: x}}}}\n'
    one = '/left/detector: {ros__parameters: {max_packets: 3}}\n'
    own = f'/**/detector: {{ros__parameters: {{use_sim_time: true, {qos}, bit_period: 0.05}}}}\n'
    (tmp_path / 'p.yaml').write_text(shared + own + one)
    assert load_parameters(tmp_path / 'p.yaml') == {'bit_period': 0.05, 'max_packets': 3}
