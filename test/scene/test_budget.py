# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command `retrolidar budget`."""

import json
import math
from typing import Any

import numpy as np
import pytest

from evaluation.bench.judging import judged
from evaluation.bench.recordings import record
from evaluation.bench.stresses import PLAIN
from retrolidar_ros.cli.main import main
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.marker_budget import NEEDED_SNR_DB, needed_swing
from retrolidar_ros.scene.reference import WALL_SIGNAL

Output = pytest.CaptureFixture[str]

FIELDS = {
    'link': ['bright', 'dark', 'noise', 'snr_db', 'reach_m'],
    'wake_up': ['voltage_v', 'threshold_v', 'woken', 'range_m'],
    'battery': ['drawn_ma', 'total_ma', 'life_h'],
}


def budget_of(capsys: Output, *options: str) -> dict[str, Any]:
    assert main(['budget', '--json', *options]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    content: dict[str, Any] = json.loads(line)
    return content


def test_the_default_is_the_papers_marker_at_2_m(capsys: Output) -> None:
    found = budget_of(capsys)
    case = ['size_m', 'yaw_rad', 'distance_m', 'cell_mah', 'queries_per_hour']
    assert list(found) == [*case, *FIELDS]
    assert [found[name] for name in case] == [0.03, 0.0, 2.0, 90.0, 1.0]
    for part, names in FIELDS.items():
        assert list(found[part]) == names
    link = found['link']
    assert link['bright'] == pytest.approx(4 + 26, rel=0.02)
    assert link['bright'] - link['dark'] == pytest.approx(needed_swing(link['snr_db']))
    assert link['snr_db'] > NEEDED_SNR_DB
    assert 2.7 < link['reach_m'] < 3.0
    assert found['wake_up']['woken']
    assert found['wake_up']['range_m'] == pytest.approx(2.25)
    assert found['battery']['life_h'] / 24 == pytest.approx(82.7, abs=0.1)
    assert found['battery']['total_ma'] == pytest.approx(sum(found['battery']['drawn_ma'].values()))


def test_at_its_reach_most_lone_packets_are_read() -> None:
    rng = np.random.default_rng(1)
    signal = needed_swing(NEEDED_SNR_DB)
    sent = [record(PLAIN, signal, rng, USABLE_IDS) for _ in range(6)]
    read = [judged(one, {'method': 'joint'}).right for one in sent]
    assert 0.68 < np.mean(read) < 0.92  # 80 % within three deviations


def test_a_turned_marker_shows_less_or_nothing(capsys: Output) -> None:
    facing, turned = budget_of(capsys), budget_of(capsys, '--yaw', '50 deg')
    swing = [found['link']['bright'] - WALL_SIGNAL for found in (facing, turned)]
    assert swing[1] == pytest.approx(swing[0] * math.cos(math.radians(50)))
    assert turned['wake_up']['range_m'] == pytest.approx(2.25 * math.cos(math.radians(50)) ** 0.5)
    options = ('--yaw', '60deg', '--distance', '1m')
    away = budget_of(capsys, *options)
    assert (away['link']['snr_db'], away['link']['reach_m']) == (None, 0)
    assert (away['wake_up']['woken'], away['wake_up']['range_m']) == (False, 0)
    assert main(['budget', *options]) == 0
    output = capsys.readouterr().out
    assert 'nothing comes back' in output
    assert 'wakes at no distance' in output
