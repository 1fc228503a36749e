# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recorded frames to detections, and detections to lines of text."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator

from retrolidar_ros.detector import Detection, Detector, create_detector
from retrolidar_ros.sensor.frame import Frame


def detect(frames: Iterable[Frame], method: str) -> Iterator[Detection]:
    """Yield the detections in frames as they become certain.

    Frames are taken one by one, as in the node, so both give the same detections.

    Raises
    ------
    ValueError
        If there is no such method.
    """
    detector: Detector | None = None
    grid = None
    for frame in frames:
        if detector is None or frame.grid != grid:
            grid = frame.grid
            detector = create_detector(method, grid)
        yield from detector.update(frame)


def to_json(detection: Detection) -> str:
    """Return a detection as one line of JSON: metres, decibels, nats, seconds of ROS time.

    Values that a method does not measure are null.
    """
    x, y, z = detection.place.position_m.tolist()
    return json.dumps(
        {
            'stamp': detection.stamp_ns * 1e-9,
            'id': detection.id,
            'x': x,
            'y': y,
            'z': z,
            'range': detection.place.range_m,
            'range_stddev': detection.place.range_stddev_m,
            'snr': detection.snr_db,
            'evidence': _or_none(detection.evidence),
            'decision_margin': _or_none(detection.decision_margin),
            'score': detection.score,
            'bit_period': detection.bit_period_s,
            'corrected_bits': detection.corrected_bits,
            'packets': detection.packets,
            'zones': list(detection.zones),
            'start': detection.start_ns * 1e-9,
            'end': detection.end_ns * 1e-9,
        }
    )


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


TEXT_HEADER = (
    '        stamp [s]    id  range [m]  SNR [dB]  evidence  margin  score  corrected  packets'
    '  zones'
)


def to_text(detection: Detection) -> str:
    """Return a detection as one line under `TEXT_HEADER`."""
    zones = ','.join(map(str, detection.zones))
    return (
        f'{detection.stamp_ns * 1e-9:17.3f}  {detection.id:4d}  {detection.place.range_m:9.3f}  '
        f'{detection.snr_db:8.1f}  {detection.evidence:8.1f}  {detection.decision_margin:6.1f}  '
        f'{detection.score:5.2f}  {detection.corrected_bits:9d}  {detection.packets:7d}  {zones}'
    )
