# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""AprilTags instead of LiDAR markers, at the same places, seen by a camera in the same hand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from evaluation.bench import places as hand
from evaluation.bench.hand_trials import Visit, errors_for
from evaluation.bench.places import pose_of_tf, rms
from evaluation.peers.camera import FOCAL_PX, Background, Pose, expose, facing, facing_pose, tilted
from evaluation.peers.visual_markers import APRILTAG, AprilTagReader, square_range
from retrolidar_ros.scene import Scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.reading import Errors, Reading

_SIZE_M, _LUX, _TAG = 0.03, 300.0, 7
_RANGES_M, _TRIES = (0.8, 1.2, 1.6, 1.9, 2.2), 16
_PICTURES = 3  # whose mean is a reading; more of them leave what pixels do to corners
_ROLL_RAD, _TILT_RAD, _AIM_RAD = 0.6, 0.2, math.radians(5)
_EXACT = 1e-5


class TagCamera:
    """A camera that reads tags, and knows how well it does."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Take pictures of tags at known places to learn the deviations."""
        self._reader = AprilTagReader(APRILTAG, 2.0)
        self._background = Background(rng)
        turns, self._stddev_m = [], []
        for range_m in _RANGES_M:
            off_m = []
            for _ in range(_TRIES):
                pose = facing_pose(range_m, 3 * FOCAL_PX * _SIZE_M / range_m, _ROLL_RAD, rng)
                seen_m = self._see(tilted(pose, *rng.uniform(-_TILT_RAD, _TILT_RAD, 2)), rng)
                if seen_m is not None:
                    seen_range_m = float(np.linalg.norm(seen_m))
                    turns += (seen_m / seen_range_m - pose.position_m / range_m)[:2].tolist()
                    off_m.append(seen_range_m - range_m)
            self._stddev_m.append(rms(off_m) or math.nan)
        self.turn_rad = rms(turns) or math.nan
        """Deviation of a direction, along each axis."""

    def errors(self, pose_m: float) -> Errors:
        """Return the errors that landmarks have to assume."""
        others = errors_for(pose_m)
        own = {'range_bias_m': 1e-4, 'range_m': 0.0, 'box_rad': 0.0, 'edge_rad': self.turn_rad}
        return replace(others, **own, turn_rad=others.turn_rad if pose_m else _EXACT)

    def readings(
        self, trial: Sequence[Visit], world: Scene, pose_m: float, rng: np.random.Generator
    ) -> list[Reading]:
        """Return what it reads from where a hand has been.

        It looks at each tag, about in the middle of its picture: a hand that shows all LiDAR
        markers to their sensor would lose some of the tags. Tags face the world's origin.
        """
        rows = []
        for index, visit in enumerate(trial):
            for marker in world.markers:
                at_m = np.array(marker.position_m)
                turns = np.append(rng.uniform(-_AIM_RAD, _AIM_RAD, 2), 0.0)
                camera = hand.towards(at_m, visit.pose.position_m, turns)
                tag = Pose(hand.to_sensor(camera, at_m), camera.rotation.T @ facing(at_m).rotation)
                seen_m = self._see(tag, rng)
                if seen_m is not None:
                    range_m, pose = float(np.linalg.norm(seen_m)), pose_of_tf(camera, pose_m, rng)
                    stddev_m = float(np.interp(range_m, _RANGES_M, self._stddev_m))
                    direction, exact = seen_m / range_m, np.full(2, _EXACT)
                    where = (range_m, stddev_m, direction, exact, pose)
                    rows.append(Reading(marker.id, 'camera', 100.0 * index, *where))
        return rows

    def _see(self, pose: Pose, rng: np.random.Generator) -> Floats | None:
        """Return where a tag is in the camera's frame [m], by the mean of pictures that show it."""
        plate = self._reader.plate(_TAG, _SIZE_M)
        light, window = self._background.with_plate(plate.cells, plate.side_m, pose)
        found = []
        for _ in range(_PICTURES):
            for tag in self._reader.detector.detect(expose(light, _LUX, rng)):
                if tag.tag_id == _TAG:
                    edge_m = _SIZE_M * self._reader.border
                    ray = np.append((np.array(tag.center) - window.centre_px) / FOCAL_PX, 1.0)
                    range_m = square_range(tag.corners, window.centre_px, edge_m)
                    found.append(range_m * ray / np.linalg.norm(ray))
        return np.mean(found, axis=0) if found else None
