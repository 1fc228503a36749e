# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What wakes a marker, how long its battery lasts, and the command that says so."""

import json
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.bench.judging import judged
from evaluation.bench.recordings import record
from evaluation.bench.stresses import PLAIN
from retrolidar_ros.cli.main import main
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.marker.power import (
    GUARD_V,
    LARGEST_ANGLE_RAD,
    NOISE_V,
    THRESHOLD_V,
    voltage_v,
    wakeup_range_m,
)
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


def test_outdoors_the_indoor_threshold_keeps_the_marker_awake() -> None:
    assert wakeup_range_m(THRESHOLD_V, NOISE_V['outdoors']) == math.inf
    outdoors = wakeup_range_m(NOISE_V['outdoors'] + GUARD_V, NOISE_V['outdoors'])
    assert outdoors == pytest.approx(1.85, abs=0.01)
    # An infrared camera does not wake it; and where there is less noise, more light is needed.
    assert 2.25 < wakeup_range_m(THRESHOLD_V, NOISE_V['LED']) < math.inf
    assert wakeup_range_m(THRESHOLD_V, NOISE_V['dark']) < 2.25


def test_beyond_the_largest_angle_there_is_noise_only() -> None:
    for angle in (math.radians(55.5), -math.radians(56), math.pi / 2):
        assert float(voltage_v(np.array(0.3), angle)) == NOISE_V['indoors']
        assert wakeup_range_m(angle_rad=angle) == 0
    assert float(voltage_v(np.array(1.0), math.radians(54.9))) > NOISE_V['indoors']


@given(st.floats(0, LARGEST_ANGLE_RAD), st.sampled_from([*NOISE_V.values()]), st.floats(1e-4, 0.1))
def test_range_and_voltage_agree(angle: float, noise_v: float, guard_v: float) -> None:
    range_m = wakeup_range_m(noise_v + guard_v, noise_v, angle)
    assert float(voltage_v(np.array(range_m), angle, noise_v)) == pytest.approx(noise_v + guard_v)
    assert wakeup_range_m(noise_v + 2 * guard_v, noise_v, angle) < range_m
