# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
from pathlib import Path

import numpy as np
import pytest

from retrolidar_ros.cli.main import main
from retrolidar_ros.detector import METHODS

FIELDS = [
    'stamp',
    'id',
    'x',
    'y',
    'z',
    'range',
    'range_stddev',
    'snr',
    'evidence',
    'decision_margin',
    'score',
    'bit_period',
    'corrected_bits',
    'packets',
    'zones',
    'start',
    'end',
]
PNG = b'\x89PNG\r\n\x1a\n'


@pytest.fixture(scope='module', params=['mcap', 'sqlite3'])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('bags') / str(request.param)
    arguments = ['--bag', str(path), '--storage', request.param, '--duration', '8']
    assert main(['emulate', 'coffee', *arguments]) == 0
    return path


def test_decode_prints_one_json_object_a_detection(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['decode', str(bag), '--json']) == 0
    detections = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {2073, 2096, 2107} <= {detection['id'] for detection in detections}
    for detection in detections:
        assert list(detection) == FIELDS
        place = [detection['x'], detection['y'], detection['z']]
        assert np.linalg.norm(place) == pytest.approx(detection['range'])
        # From any bit of a repeating marker on, so the first packet may have begun earlier.
        packets = (detection['end'] - detection['start']) / 1.302
        assert detection['packets'] - 0.04 < packets < detection['packets'] + 1.04
    ends = [detection['end'] for detection in detections]
    assert ends == sorted(ends)


@pytest.mark.parametrize('method', METHODS)
def test_decode_reads_by_any_method(
    bag: Path, method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['decode', str(bag), '--json', '--method', method]) == 0
    ids = {json.loads(line)['id'] for line in capsys.readouterr().out.splitlines()}
    assert ids >= {2073, 2096, 2107}


def test_decode_prints_a_table(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['decode', str(bag)]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert header.split() == [
        'stamp',
        '[s]',
        'id',
        'range',
        '[m]',
        'SNR',
        '[dB]',
        'evidence',
        'margin',
        'score',
        'corrected',
        'packets',
        'zones',
    ]
    assert {row.split()[1] for row in rows} >= {'2073', '2096', '2107'}


def test_plot_writes_a_picture(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / 'picture.png'
    assert main(['plot', str(bag), '-o', str(picture)]) == 0
    assert picture.read_bytes().startswith(PNG)
    assert 'readings' in capsys.readouterr().out


def cut(bag: Path) -> Path:
    """Cut off the last third of a bag's data."""
    (file,) = (path for path in bag.iterdir() if path.suffix in ('.mcap', '.db3'))
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    return bag


@pytest.fixture
def damaged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    path = tmp_path / 'damaged'
    assert main(['emulate', 'coffee', '--bag', str(path), '--duration', '8']) == 0
    capsys.readouterr()
    return cut(path)


def test_what_was_readable_before_the_damage_is_decoded(
    damaged: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['decode', str(damaged), '--json']) == 2
    output = capsys.readouterr()
    assert {json.loads(line)['id'] for line in output.out.splitlines()} >= {2073, 2096, 2107}
    assert str(damaged) in output.err
    assert 'Traceback' not in output.err


def test_what_was_readable_before_the_damage_is_drawn(
    damaged: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / 'picture.png'
    assert main(['plot', str(damaged), '-o', str(picture)]) == 2
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['decode', 'nowhere'], 'nowhere does not exist'),
        (
            ['emulate', 'nowhere', '--port-link', 'port'],
            'no scene nowhere; .* coffee, drone, range',
        ),
        (['demo', 'nowhere'], 'no scene nowhere'),
    ],
)
def test_unusable_input_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    with pytest.raises(ValueError, match=message):
        raise ValueError(error)


def test_an_unknown_topic_names_those_there_are(
    bag: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['decode', str(bag), '--topic', '/frames']) == 2
    assert '/retrolidar/frames (retrolidar_ros/msg/Frame)' in capsys.readouterr().err


@pytest.mark.parametrize('option', ['--method', '--storage'])
def test_an_unknown_choice_names_the_choices(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ['decode', 'bag'] if option == '--method' else ['emulate', 'coffee', '--bag', 'bag']
    with pytest.raises(SystemExit, match='2'):
        main([*command, option, 'magic'])
    assert 'choose from' in capsys.readouterr().err
