# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections and landmarks as shapes that RViz and Foxglove draw."""

from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Duration
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker

from retrolidar_ros.nodes.conversion import Marked, covariance_of, to_pose, vector_of
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import quaternion_of
from retrolidar_ros.tasks.landmarks import Estimate

_DEVIATIONS = 2.0  # half axes of the drawn ellipsoid, in standard deviations
_MIN_DIAMETER_M = 0.01
_LABEL_HEIGHT_M = 0.05
_COLOUR = {'r': 0.0, 'g': 0.62, 'b': 0.45}
_UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def marker_shapes(detection: Marked, stale_after_s: float) -> list[Marker]:
    """Return an ellipsoid of the covariance and a label, removed when stale."""
    position_m = vector_of(detection.pose.pose.position)
    covariance = covariance_of(detection.pose)[:3, :3]
    text = f'{detection.child_frame_id}\n{detection.range:.3f} m'
    shapes = _ellipsoid(detection.header, position_m, covariance, text, detection.id)
    # In the optical frame, up is against y.
    shapes[1].pose.position.y -= _LABEL_HEIGHT_M
    seconds, share = divmod(stale_after_s, 1.0)
    for shape in shapes:
        shape.lifetime = Duration(sec=int(seconds), nanosec=int(share * 1e9))
    return shapes


def landmark_shapes(header: Header, estimates: Sequence[Estimate]) -> list[Marker]:
    """Return ellipsoids and labels of all landmarks, and remove all others."""
    shapes = [Marker(header=header, action=Marker.DELETEALL)]
    for index, estimate in enumerate(estimates):
        text = f'{estimate.name}\n±{1e3 * estimate.stddev_m:.0f} mm'
        pair = _ellipsoid(header, estimate.position_m, estimate.covariance[:3, :3], text, index)
        pair[1].pose.position.z += _LABEL_HEIGHT_M
        shapes += pair
    return shapes


def _ellipsoid(
    header: Header, position_m: Floats, covariance: Floats, text: str, identity: int
) -> list[Marker]:
    variances, axes = np.linalg.eigh(covariance)
    # Eigenvectors may be a reflection; the ellipsoid is the same.
    orientation = quaternion_of(axes * np.sign(np.linalg.det(axes)))
    ellipsoid = Marker(type=Marker.SPHERE, pose=to_pose(position_m, orientation))
    diameters = 2 * _DEVIATIONS * np.sqrt(np.maximum(variances, 0.0))
    scale = ellipsoid.scale
    scale.x, scale.y, scale.z = np.maximum(diameters, _MIN_DIAMETER_M).tolist()
    label = Marker(type=Marker.TEXT_VIEW_FACING, pose=to_pose(position_m, _UPRIGHT), text=text)
    label.scale.z = _LABEL_HEIGHT_M
    for shape, layer, opacity in ((ellipsoid, 'place', 0.35), (label, 'label', 1.0)):
        # Two sensors with one topic may see the same marker.
        shape.header, shape.ns, shape.id = header, f'{header.frame_id}/{layer}', identity
        shape.color = ColorRGBA(**_COLOUR, a=opacity)
    return [ellipsoid, label]
