# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The description of the sensor for a robot's own."""

import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.settings.resources import shared_file

ROOT = Path(__file__).resolve().parents[2]


def rotation(roll: float, pitch: float, yaw: float) -> Floats:
    """Return the matrix of URDF's angles: about the fixed axes x, then y, then z."""
    about_x, about_y, about_z = map(matrix_of_turn, np.diag([roll, pitch, yaw]))
    turn: Floats = about_z @ about_y @ about_x
    return turn


def test_the_optical_frame_looks_along_the_x_of_its_link() -> None:
    """REP 103: what is ahead of the sensor is at z of the optical frame, its right at x."""
    robot = ElementTree.parse(shared_file('urdf/retrolidar.urdf.xacro')).getroot()
    (joint,) = (j for j in robot.iter('joint') if j.get('name') == '${name}_optical_joint')
    origin, parent, child = (joint.find(tag) for tag in ('origin', 'parent', 'child'))
    assert origin is not None
    assert parent is not None
    assert child is not None
    assert (parent.get('link'), child.get('link')) == ('${name}_link', '${name}_optical_frame')
    turn = rotation(*map(float, str(origin.get('rpy')).split()))
    right, down, ahead = turn.T
    assert ahead == pytest.approx([1, 0, 0], abs=1e-9)
    assert right == pytest.approx([0, -1, 0], abs=1e-9)
    assert down == pytest.approx([0, 0, -1], abs=1e-9)


def test_the_documented_mounting_looks_ahead() -> None:
    file = ROOT / 'docs' / 'troubleshooting.md'
    (line,) = (x for x in file.read_text().splitlines() if 'static_transform_publisher' in x)
    angles = {name: float(value) for name, value in re.findall(r'--(roll|pitch|yaw) (\S+)', line)}
    turn = rotation(*(angles.get(name, 0.0) for name in ('roll', 'pitch', 'yaw')))
    assert turn[:, 2] == pytest.approx([1, 0, 0], abs=1e-6)
    assert turn[:, 0] == pytest.approx([0, -1, 0], abs=1e-6)
