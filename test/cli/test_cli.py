# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from retrolidar_ros.cli.main import main
from retrolidar_ros.detector import METHODS

FIELDS = (
    'stamp id x y z range range_stddev snr evidence decision_margin score bit_period '
    'corrected_bits packets zones start end'
)
HEADER = 'stamp [s] id range [m] SNR [dB] evidence margin score corrected packets zones'
COFFEE = {2073, 2096, 2107}
Output = pytest.CaptureFixture[str]
PNG = b'\x89PNG\r\n\x1a\n'


@pytest.fixture(scope='module', params=['mcap', 'sqlite3'])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip('rosbags', reason='bags are written with rosbags')
    path = tmp_path_factory.mktemp('bags') / str(request.param)
    arguments = ['--bag', str(path), '--storage', request.param, '--duration', '8']
    assert main(['emulate', 'coffee', *arguments]) == 0
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
        # From any bit of a repeating marker on, so the first packet may have begun earlier.
        packets = (detection['end'] - detection['start']) / 1.302
        assert detection['packets'] - 0.04 < packets < detection['packets'] + 1.04
    assert method != METHODS[0] or detections == decoded(capsys, bag)
    ends = [detection['end'] for detection in detections]
    assert ends == sorted(ends)


def test_decode_prints_a_table(bag: Path, capsys: Output) -> None:
    assert main(['decode', str(bag)]) == 0
    header, *rows = capsys.readouterr().out.splitlines()
    assert ' '.join(header.split()) == HEADER
    assert {int(row.split()[1]) for row in rows} >= COFFEE


def test_plot_writes_a_picture(bag: Path, tmp_path: Path, capsys: Output) -> None:
    picture = tmp_path / 'picture.png'
    assert main(['plot', str(bag), '-o', str(picture)]) == 0
    assert picture.read_bytes().startswith(PNG)
    assert 'readings' in capsys.readouterr().out


def test_a_damaged_bag_is_decoded_and_drawn(bag: Path, tmp_path: Path, capsys: Output) -> None:
    damaged, picture = tmp_path / 'damaged', tmp_path / 'picture.png'
    shutil.copytree(bag, damaged)
    (file,) = (path for path in damaged.iterdir() if path.suffix in ('.mcap', '.db3'))
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 2 // 3])
    assert main(['decode', str(damaged)]) == 2
    error = capsys.readouterr().err
    assert str(damaged) in error
    assert 'Traceback' not in error
    decoded(capsys, damaged, code=2)
    assert main(['plot', str(damaged), '-o', str(picture)]) == 2
    assert picture.read_bytes().startswith(PNG)


@pytest.mark.parametrize(
    ('arguments', 'message'),
    [
        (['decode', 'nowhere'], 'nowhere does not exist'),
        (['decode', 'BAG', '--topic', '/x'], '/retrolidar/frames .retrolidar_ros/msg/Frame'),
        (
            ['emulate', 'nowhere', '--port-link', 'port'],
            'no scene nowhere; .* coffee, drone, range',
        ),
        (['demo', 'nowhere'], 'no scene nowhere'),
    ],
)
def test_unusable_input_is_one_line(
    bag: Path, arguments: list[str], message: str, capsys: Output
) -> None:
    assert main([str(bag) if word == 'BAG' else word for word in arguments]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(message, line)
    choices = (['decode', 'bag', '--method'], ['emulate', 'coffee', '--bag', 'bag', '--storage'])
    for command in choices:
        with pytest.raises(SystemExit, match='2'):
            main([*command, 'magic'])
        assert 'choose from' in capsys.readouterr().err
