# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections as messages of vision_msgs, where that package is installed."""

from __future__ import annotations

from typing import Any

from retrolidar_ros.msg import MarkerDetection


def to_detections(messages: list[MarkerDetection]) -> Any:
    """Return detections of one frame as a `vision_msgs/Detection3DArray`.

    The class of a hypothesis is the ID, and its score the correlation with the sent packet.
    """
    from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose

    array = Detection3DArray(header=messages[0].header)
    for message in messages:
        hypothesis = ObjectHypothesisWithPose(pose=message.pose)
        hypothesis.hypothesis.class_id = str(message.id)
        hypothesis.hypothesis.score = float(message.score)
        detection = Detection3D(header=message.header, id=message.child_frame_id)
        detection.results = [hypothesis]
        detection.bbox.center = message.pose.pose
        array.detections.append(detection)
    return array
