# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections as shapes that RViz and Foxglove draw."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Duration
from visualization_msgs.msg import Marker

from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.sensor.rotation import quaternion_of

_DEVIATIONS = 2.0  # half axes of the drawn ellipsoid, in standard deviations
_LEAST_DIAMETER_M = 0.01
_LABEL_HEIGHT_M = 0.05
_COLOUR = (0.0, 0.62, 0.45)


def marker_shapes(detection: MarkerDetection, stale_after_s: float) -> list[Marker]:
    """Return an ellipsoid of the covariance and a label, which vanish when they are stale."""
    covariance = np.array(detection.pose.covariance).reshape(6, 6)[:3, :3]
    variances, axes = np.linalg.eigh(covariance)
    ellipsoid = _shape(detection, Marker.SPHERE, 'place', 0.35, stale_after_s)
    diameters = 2 * _DEVIATIONS * np.sqrt(np.maximum(variances, 0.0))
    scale = ellipsoid.scale
    scale.x, scale.y, scale.z = np.maximum(diameters, _LEAST_DIAMETER_M).tolist()
    orientation = ellipsoid.pose.orientation
    # Eigenvectors may be mirrored, which no rotation is; an ellipsoid does not mind.
    turn = quaternion_of(axes * np.sign(np.linalg.det(axes)))
    orientation.x, orientation.y, orientation.z, orientation.w = turn.tolist()
    label = _shape(detection, Marker.TEXT_VIEW_FACING, 'label', 1.0, stale_after_s)
    label.scale.z = _LABEL_HEIGHT_M
    label.pose.position.y -= _LABEL_HEIGHT_M
    label.text = f'{detection.child_frame_id}\n{detection.range:.3f} m'
    return [ellipsoid, label]


def _shape(
    detection: MarkerDetection, kind: int, layer: str, opacity: float, stale_after_s: float
) -> Marker:
    seconds, share = divmod(stale_after_s, 1.0)
    shape = Marker(
        header=detection.header,
        # Two sensors may share a topic, and see the same marker.
        ns=f'{detection.header.frame_id}/{layer}',
        id=detection.id,
        type=kind,
        action=Marker.ADD,
        lifetime=Duration(sec=int(seconds), nanosec=int(share * 1e9)),
    )
    place = detection.pose.pose.position
    shape.pose.position.x, shape.pose.position.y = place.x, place.y
    shape.pose.position.z = place.z
    shape.color.r, shape.color.g, shape.color.b = _COLOUR
    shape.color.a = opacity
    return shape
