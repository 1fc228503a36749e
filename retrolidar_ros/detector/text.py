# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections to stable lines of text."""

from __future__ import annotations

import json
import math

from retrolidar_ros.detector import Detection


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
