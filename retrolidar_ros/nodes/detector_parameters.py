# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the detector node: those of the detector, and how detections are published."""

from __future__ import annotations

from typing import Any

from retrolidar_ros.detector.settings import PARAMETERS
from retrolidar_ros.nodes.parameters import Parameters, check_frame_id

NAME = '{name}'
"""What stands for a marker's name in `child_frame`."""


def check_child_frame(values: dict[str, Any]) -> None:
    """Raise ValueError if `child_frame` cannot name markers."""
    if values['child_frame'].count(NAME) != 1:
        raise ValueError(f'child_frame: {values["child_frame"]!r} needs {NAME} once')
    check_frame_id('child_frame', values['child_frame'])


def declare(parameters: Parameters) -> None:
    """Declare all of them."""
    for name, one in PARAMETERS.items():
        if one.kind is str:
            parameters.text(name, one.description, one.among, live=one.live)
        elif one.kind is bool:
            parameters.flag(name, one.description, live=one.live)
        elif one.kind is float:
            parameters.number(name, one.description, *one.limits, live=one.live)
        else:
            whole = parameters.integer if one.kind is int else parameters.integers
            whole(name, one.description, *map(int, one.limits), live=one.live)
    parameters.flag('publish_tf', 'Send a transform for every detection.', live=True)
    parameters.text('child_frame', 'TF frame of a marker; {name} stands for its name.')
    parameters.number(
        'stale_after',
        'How long marker_array shows a marker after a reading [s].',
        0.1,
        3600.0,
        live=True,
    )
