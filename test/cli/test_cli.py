# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
import re
import shutil
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from retrolidar_ros.cli.main import main
from retrolidar_ros.detector import METHODS
from retrolidar_ros.detector.decoding import Decoding

FIELDS = (
    'stamp id x y z range range_stddev snr evidence decision_margin score bit_period '
    'corrected_bits packets zones start end'
)
COFFEE = {2073, 2096, 2107}
Output = pytest.CaptureFixture[str]
PNG = b'\x89PNG\r\n\x1a\n'


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip('rosbags', reason='bags are written with rosbags')
    path = tmp_path_factory.mktemp('bags') / 'bag'
    assert main(['emulate', 'coffee', '--bag', str(path), '--duration', '8']) == 0
    return path


def decoded(output: Output, *arguments: str | Path, code: int = 0) -> list[dict[str, Any]]:
    """Return what `decode --json` prints of the coffee scene."""
    assert main(['decode', '--json', *map(str, arguments)]) == code
    detections = [json.loads(line) for line in output.readouterr().out.splitlines()]
    assert {detection['id'] for detection in detections} >= COFFEE
    return detections


@pytest.mark.parametrize('method', METHODS)
def test_decode_prints_one_json_object_a_detection(bag: Path, method: str, capsys: Output) -> None:
    detections = decoded(capsys, bag, '--method', method)
    for detection in detections:
        assert ' '.join(detection) == FIELDS
        place = [detection['x'], detection['y'], detection['z']]
        assert np.linalg.norm(place) == pytest.approx(detection['range'])
        # From any bit of a repeating marker on; most of the first packet was used.
        packets = (detection['end'] - detection['start']) / 1.302
        assert detection['packets'] - 0.54 < packets < detection['packets'] + 0.54
        # What a method does not measure is null.
        nats = [detection['evidence'], detection['decision_margin']]
        assert nats == [None, None] if method == 'paper' else min(nats) > 6
    assert method != METHODS[0] or detections == decoded(capsys, bag)
    ends = [detection['end'] for detection in detections]
    assert ends == sorted(ends)


def test_decode_prints_where_markers_are_at_every_frame(bag: Path, capsys: Output) -> None:
    tracks = decoded(capsys, bag, '--tracks')
    assert set(tracks[0]) == {
        *('stamp', 'id', 'x', 'y', 'z', 'x_stddev', 'y_stddev', 'z_stddev'),
        *('vx', 'vy', 'vz', 'range', 'range_stddev', 'presence'),
    }
    own = [one for one in tracks if one['id'] == 2073]
    stamps = np.array([one['stamp'] for one in own])
    assert np.median(np.diff(stamps)) < 0.03
    for one in own:
        assert np.linalg.norm([one['x'], one['y'], one['z']]) == pytest.approx(one['range'])
        assert abs(one['range'] - 1.0) < 0.02
        assert one['range_stddev'] < 0.02
    # Across the line of sight it is known as well as a zone and its neighbours say.
    assert all(0.001 < own[-1][name] < 0.1 for name in ('x_stddev', 'y_stddev'))
    assert main(['decode', '--tracks', str(bag)]) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert not any('-0.000' in text.split()[7] for text in lines)
    assert len(lines) == len(tracks)
    assert len(header) == len(lines[0])
    assert main(['decode', '--tracks', '--method', 'paper', str(bag)]) == 2
    assert 'method paper follows no markers' in capsys.readouterr().err


def test_a_damaged_bag_is_used_up_to_the_damage(bag: Path, tmp_path: Path, capsys: Output) -> None:
    damaged, picture = tmp_path / 'damaged', tmp_path / 'picture.png'
    shutil.copytree(bag, damaged)
    (file,) = damaged.glob('*.mcap')
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    assert main(['decode', str(damaged)]) == 2
    error = capsys.readouterr().err
    assert str(damaged) in error
    assert 'Traceback' not in error
    decoded(capsys, damaged, code=2)
    assert main(['plot', str(damaged), '-o', str(picture)]) == 2
    assert picture.read_bytes().startswith(PNG)
    assert capsys.readouterr().err.endswith(error)
    assert main(['calibrate', str(damaged), '-o', str(tmp_path / 'calibration')]) == 2
    assert (tmp_path / 'calibration' / 'calibration.yaml').exists()
    assert capsys.readouterr().err == error


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ('decode nowhere', 'nowhere does not exist'),
        ('decode BAG --topic /x', '.*/retrolidar/frames .retrolidar_ros/msg/Frame'),
        ('decode BAG --params no.yaml', 'no.yaml cannot be read: No such file or directory'),
        ('plot BAG -o .', r'\. is a directory; name a PNG file'),
        # Before a long calibration.
        ('calibrate nowhere -o pyproject.toml', r'pyproject\.toml is a file; name a directory'),
        ('emulate nowhere', '.*no scene nowhere'),
        (
            'emulate coffee',
            'emulate needs --port-link PATH or --bag DIR.* emulate --help',
        ),
        ('emulate nowhere --port-link port', '.*no scene nowhere; .* coffee, drone, range'),
        ('ids --count 4095', '4095 IDs cannot be chosen'),
        ('budget --size 1m', "--size: '1m' is impossible"),  # larger than a zone
        ('budget --distance 2km', "--distance: '2km' is in km; it needs m or cm or mm"),
        ('budget --queries 1e4', '10000 queries an hour .* 0 to 2765'),
    ],
)
def test_unusable_input_is_a_line(bag: Path, arguments: str, message: str, capsys: Output) -> None:
    assert main(arguments.replace('BAG', str(bag)).split()) == 2
    output = capsys.readouterr()
    assert output.out == ''
    (line,) = output.err.splitlines()
    assert re.match(f'retrolidar: {message}', line)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        ('decode bag --method magic', 'choose from'),
        ('emulate coffee --bag bag --duration nan', "'nan' is"),
        ('plot bag -o no/such/x.png', 'there is no directory no/such; make it first'),
        ('watch port --bit-period 11', '11.0 is not within'),
        (
            'watch port --duration 0.1 --baud=-5',
            '--baud: serial_baud: -5 is not within 9600 to 12000000',
        ),
        (
            'record port -o bag --duration 0.1 --baud 12000001',
            '12000001 is not within 9600 to 12000000',
        ),
        ('watch port --duration 0.1 --baud fast', '--baud: fast is no INTEGER'),
        ('emulate coffee --seed=-1', '--seed: -1 is impossible; 0 to 9223372036854775807'),
        ('emulate coffee --seed 1.5', "--seed: '1.5' is not a whole number"),
        ('ids', 'one of the arguments --count --check is required'),
        ('ids --count 3 --check 3,17', 'not allowed with'),
        ('decode bag --max-packts=3', '--max-packts=3; did you mean --max-packets?'),
        ('ids --check 3,,17', "'3,,17' is no list of IDs such as 3,17,42"),
    ],
)
def test_arguments_that_do_not_fit(arguments: str, message: str, capsys: Output) -> None:
    with pytest.raises(SystemExit, match=r'^2$'):
        main(arguments.split())
    error, more = capsys.readouterr().err.splitlines()
    command = f'retrolidar {arguments.split()[0]}'
    assert error.startswith(f'{command}: ')
    assert message in error
    assert more == f'See {command} --help'


def test_a_picture_is_explained_once(
    bag: Path, tmp_path: Path, capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    explain = Mock(wraps=Decoding.explanation)
    monkeypatch.setattr(Decoding, 'explanation', lambda decoding: explain(decoding))
    arguments = ['--registered-ids', '5', '-o', str(tmp_path / 'picture.png')]
    assert main(['plot', str(bag), *arguments]) == 3
    assert 'would be read if registered_ids held it' in capsys.readouterr().err
    assert explain.call_count == 1


def test_versions_scenes_and_units(bag: Path, capsys: Output) -> None:
    with pytest.raises(SystemExit, match=r'^0$'):
        main(['--version'])
    assert re.fullmatch(r'retrolidar \d+\.\d+\.\d+\n', capsys.readouterr().out)
    assert main(['emulate']) == 0
    scenes = capsys.readouterr().out
    assert [line.split()[0] for line in scenes.splitlines()] == ['arm', 'coffee', 'drone', 'range']
    assert decoded(capsys, bag, '--bit-period', '42 ms', '--range-offset', '1mm') == decoded(
        capsys, bag, '--bit-period', '0.042', '--range-offset', '0.001'
    )
    budgets = []
    for distance in ('1.5 m', '1.5', '150cm'):
        assert main(['budget', '--distance', distance]) == 0
        budgets.append(capsys.readouterr().out)
    assert len(set(budgets)) == 1
