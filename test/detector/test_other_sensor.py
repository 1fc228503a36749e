# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Another sensor and another packet: a struct and a header are all that differs."""

import json
import shutil
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from harness_core import PROGRAMS, SOURCES
from harness_firmware import need, printed


def test_8x8_zones_at_15_hz_and_a_packet_of_27_bits_are_read_by_one_core(tmp_path: Path) -> None:
    need('cc')
    core, made = tmp_path / 'core', tmp_path / '_core.so'
    shutil.copytree(SOURCES.parent, core)
    shutil.copy(PROGRAMS / 'other_packet.h', core / 'src' / 'retrolidar_packet_format.h')
    printed(sys.executable, core / 'binding.py', tmp_path / '_core.c')
    include = (f'-I{core / "src"}', f'-I{sysconfig.get_paths()["include"]}')
    sources = (tmp_path / '_core.c', *(core / 'src').glob('*.c'))
    printed('cc', '-std=c99', '-shared', '-fPIC', '-O1', *include, *sources, '-lm', '-o', made)
    said = printed(sys.executable, PROGRAMS / 'other_packet.py', made)
    found, by_another_model = said.splitlines()
    detections = json.loads(found)
    # ID, zone and start of the three that are sent once.
    assert {(one[0], one[3], round(one[2], 1)) for one in detections if one[0] != 500} == {
        (100, 9, 5.0),
        (311, 27, 6.4),
        (7, 62, 7.7),
    }
    # The fourth repeats.
    packets = [(one[2] - 3.0) / (27 * 0.133) for one in detections if one[0] == 500]
    assert len(packets) >= 3
    assert packets == pytest.approx(np.rint(packets), abs=0.01)
    assert [one[1] for one in detections] == pytest.approx([1.2] * len(detections), abs=5e-3)
    # Its statuses mean nothing to a detector that expects a VL53L8CX.
    assert json.loads(by_another_model) == []
