# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was read of a scene, set beside the truth."""

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.optics import position_at, seen_from
from retrolidar_ros.sensor.frame import Floats, Recording

_RARE = 16.266  # squared distance, in deviations, that holds 99.9 % of a normal in space


def is_inside(off_m: Floats, covariance: Floats) -> bool:
    """Return whether an error, shape (3,), is in the 99.9 % ellipsoid of a covariance (3, 3)."""
    return bool(off_m @ np.linalg.solve(covariance, off_m) < _RARE)


class Outcome(NamedTuple):
    """What became of one ID: a marker of the scene, or a ghost that no marker sent."""

    id: int
    name: str
    readings: int
    range_m: float  # true range, mean over the readings; NaN for a ghost
    error_m: float  # measured less true range, where it is largest; NaN without truth
    place_error_m: float  # of the position, where it is largest; NaN likewise
    place_stddev_m: float  # deviation along the worst axis, as that reading has it; NaN likewise
    is_placed: bool  # whether all positions lie in the 99.9 % ellipsoids of their covariances
    snr_db: float
    first_reading_s: float  # from the first frame to the end of the first reading; NaN without any
    has_transforms: bool

    @property
    def good(self) -> bool:
        """Whether a marker was read, is in TF, and is where its covariances say."""
        return self.readings > 0 and self.has_transforms and self.is_placed


def true_position(scene: Scene, marker: Marker, recording: Recording, stamps: Floats) -> Floats:
    """Return where a marker is [m], shape (..., 3), at stamps [ns after the recording's first]."""
    elapsed = (recording.stamp_ns - recording.stamp_ns[0]).astype(np.float64)
    sensor_s = np.interp(stamps, elapsed, recording.sensor_time_us * 1e-6)
    true_s = sensor_s.ravel() / (1 + scene.sensor.clock_error)
    positions = seen_from(scene.sensor, position_at(marker, true_s), true_s)
    return np.broadcast_to(positions, (stamps.size, 3)).reshape(*stamps.shape, 3)


def judge(
    scene: Scene,
    recording: Recording,
    readings: Sequence[Detection],
    untransformed: Collection[int] = (),
) -> list[Outcome]:
    """Set readings beside the truth, ghosts last; some of `untransformed` IDs are not in TF."""
    origin_ns = int(recording.stamp_ns[0])
    markers: dict[int, Marker | None] = {marker.id: marker for marker in scene.markers}
    for ghost in sorted({reading.id for reading in readings} - set(markers)):
        markers[ghost] = None
    outcomes = []
    for identity, marker in markers.items():
        own = [reading for reading in readings if reading.id == identity]
        truth: Floats = np.full((len(own), 3), np.nan)
        if marker is not None and own:
            stamps = np.array([reading.stamp_ns - origin_ns for reading in own], dtype=float)
            truth = true_position(scene, marker, recording, stamps)
        ranges = np.linalg.norm(truth, axis=1)
        places = [reading.place for reading in own]
        spreads = [one.covariance[:3, :3] for one in places]
        errors = [one.range_m - true for one, true in zip(places, ranges.tolist(), strict=True)]
        off = [one.position_m - true for one, true in zip(places, truth, strict=True)]
        worst = max(range(len(own)), key=lambda one: float(np.linalg.norm(off[one])), default=None)
        outcomes.append(
            Outcome(
                id=identity,
                name='ghost' if marker is None else marker.name,
                readings=len(own),
                range_m=float(ranges.mean()) if own else np.nan,
                error_m=max(errors, key=abs, default=np.nan),
                place_error_m=np.nan if worst is None else float(np.linalg.norm(off[worst])),
                place_stddev_m=np.nan if worst is None else largest_stddev(spreads[worst]),
                is_placed=all(map(is_inside, off, spreads)),
                snr_db=float(np.median([r.snr_db for r in own])) if own else np.nan,
                first_reading_s=(own[0].end_ns - origin_ns) * 1e-9 if own else np.nan,
                has_transforms=identity not in untransformed,
            )
        )
    return outcomes


def table(outcomes: Sequence[Outcome]) -> str:
    """Return outcomes as lines of text."""
    lines = [
        '     id  name        range [m]  worst [mm]  position [mm]  SNR [dB]  first [s]  times  TF'
    ]
    lines += [
        f'   {one.id:4d}  {one.name:10}  {one.range_m:9.3f}  {one.error_m * 1e3:10.1f}  '
        f'{f"{one.place_error_m * 1e3:.0f} ± {one.place_stddev_m * 1e3:.0f}":>13}  '
        f'{one.snr_db:8.1f}  {one.first_reading_s:9.2f}  {one.readings:5d}  '
        f'{"yes" if one.readings and one.has_transforms else "no"}'
        for one in outcomes
    ]
    return '\n'.join(lines)
