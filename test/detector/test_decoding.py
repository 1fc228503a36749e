# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Iterable, Iterator
from dataclasses import replace

import pytest
from harness_detector import ID, a_scene, simulate

from retrolidar_ros.bag import BagError
from retrolidar_ros.detector import METHODS
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.sensor.frame import Frame, ZoneGrid


def detect(frames: Iterable[Frame], method: str) -> Iterator[Detection]:
    return Decoding({**defaults(), 'method': method}).detect(frames)


def frames(duration_s: float = 3.0, rows: int = 4) -> list[Frame]:
    scene = a_scene(position_m=(0.05, 0.04, 1.0), start_s=1.0)
    scene = replace(scene, sensor=replace(scene.sensor, grid=ZoneGrid(rows, rows)))
    return list(simulate(scene, duration_s))


@pytest.mark.parametrize('method', METHODS)
def test_another_zone_grid_begins_anew(method: str) -> None:
    assert list(detect([], method)) == []
    several = [*frames(), *frames(rows=8), *frames()]
    read = [detection.id for detection in detect(several, method)]
    assert read.count(ID) == 3


def test_all_frames_before_an_error_count() -> None:
    def damaged() -> Iterator[Frame]:
        # The packet has just ended: its last frames are in a block that is not full.
        yield from frames(1.0 + 31 * 0.042 + 0.05)
        raise BagError('cut off')

    detections = detect(damaged(), METHODS[0])
    assert next(detections).id == ID
    with pytest.raises(BagError, match='cut off'):
        next(detections)


def test_detections_come_before_the_last_frame() -> None:
    source = iter(frames(10.0))
    assert next(detect(source, METHODS[0])).id == ID
    assert len(list(source)) > 200
