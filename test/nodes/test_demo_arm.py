# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The demo of a hand that looks from several places, with real nodes, at two of them."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from retrolidar_ros.scene.files import find_scene
from retrolidar_ros.settings.yaml_files import load_yaml


def test_objects_are_known_better_after_a_second_place(tmp_path: Path) -> None:
    scene = load_yaml(find_scene('arm'))
    here, _, _, _, _, _, there, *_ = scene['sensor']['path']
    times = (0, 5, 6, 11)
    scene['sensor']['path'] = [
        {**place, 'time': f'{time_s} s'}
        for place, time_s in zip((here, here, there, there), times, strict=True)
    ]
    file, picture = tmp_path / 'short.yaml', tmp_path / 'short.png'
    file.write_text(json.dumps(scene))  # YAML without aliases
    command = [sys.executable, '-m', 'retrolidar_ros.cli', 'demo', str(file), '-o', str(picture)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=90, cwd=tmp_path)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert '3 of 3 objects are in their 99.9 % ellipsoid' in ended.stdout
    assert picture.stat().st_size > 10_000
    spreads = [
        [float(one) for one in re.findall(r'± +([\d.]+)', line)]
        for line in re.findall(r'^  \d\. .*$', ended.stdout, re.MULTILINE)
    ]
    assert [len(one) for one in spreads] == [3, 3]
    assert all(later < first for first, later in zip(*spreads, strict=True))
