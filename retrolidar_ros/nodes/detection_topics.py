# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a detection: the message, its transform, and standard messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.detector import Detection, Detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.marker.known_markers import KnownMarker, frame_of
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import to_detection_msg, to_header, to_transform
from retrolidar_ros.nodes.qos import EVENTS, LATCHED, publisher, topic_part
from retrolidar_ros.nodes.track_topics import TrackTopics
from retrolidar_ros.nodes.transforms import transform_sender
from retrolidar_ros.nodes.visualization import marker_shapes
from retrolidar_ros.sensor.frame import Frame

try:
    from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose
except ImportError:  # not installed: no subscribers
    Detection3DArray = None
NAME = '{name}'
"""What stands for a marker's name in the parameter `child_frame`."""
_MOST_POSES = 100
_BEAT_PERIOD_NS = 200_000_000


class DetectionTopics:
    """The topics `markers`, `tracks`, `marker_array`, `detections`, `poses/NAME`, and TF."""

    def __init__(self, node: Node, known: dict[int, KnownMarker], values: dict[str, Any]) -> None:
        """Make the publishers; names of markers are those of `known`."""
        self._node = node
        self._known = known
        self._markers = publisher(node, MarkerDetection, 'markers', EVENTS)
        self._drawn = publisher(node, MarkerArray, 'marker_array', EVENTS)
        if Detection3DArray is not None:
            self._vision = publisher(node, Detection3DArray, 'detections', EVENTS)
        self._heartbeat = node.create_publisher(Header, '~/heartbeat', 10)
        if len(known) > _MOST_POSES:
            node.get_logger().warning(
                f'{len(known)} known markers: no topic poses/NAME for more than {_MOST_POSES}'
            )
            known = {}
        self._poses = {
            identity: publisher(node, PoseStamped, f'poses/{topic_part(marker.frame)}', LATCHED)
            for identity, marker in known.items()
        }
        self._send_transforms: Any = None
        self._beat_ns = 0
        self._has_tracks = False
        self.change(values)
        self._tracks = TrackTopics(
            node,
            self._child_frame,
            lambda transforms: self._send_transforms(transforms),
            self._draw,
        )

    def change(self, values: dict[str, Any]) -> None:
        """Apply new parameters."""
        self._values = values
        if values['publish_tf'] and self._send_transforms is None:
            self._send_transforms = transform_sender(self._node)

    def beat(self, stamp_ns: int, frame_id: str) -> None:
        """Report, several times a second, up to which frame all are searched."""
        if abs(stamp_ns - self._beat_ns) >= _BEAT_PERIOD_NS:
            self._beat_ns = stamp_ns
            self._heartbeat.publish(to_header(stamp_ns, frame_id))

    def follow(self, detector: Detector, frame: Frame, frame_id: str) -> None:
        """Publish the tracks at a frame; transforms come from them if parameters say so."""
        if isinstance(detector, LikelihoodDetector):
            self._has_tracks = self._values['tf_source'] == 'tracks'
            self._tracks.follow(detector, frame, frame_id, self._values)
        else:
            self._has_tracks = False

    def _child_frame(self, identity: int) -> str:
        name = frame_of(identity, self._known)
        return str(self._values['child_frame']).replace(NAME, name)

    def publish(self, detections: list[Detection], frame_id: str) -> None:
        """Publish the detections of one frame, transforms first: subscribers look them up."""
        messages = [
            to_detection_msg(detection, frame_id, self._child_frame(detection.id))
            for detection in detections
        ]
        if self._values['publish_tf'] and not self._has_tracks:
            self._send_transforms(
                [to_transform(one.header, one.child_frame_id, one.pose.pose) for one in messages]
            )
        for message in messages:
            self._markers.publish(message)
            if message.id in self._poses:
                pose = PoseStamped(header=message.header, pose=message.pose.pose)
                self._poses[message.id].publish(pose)
        if Detection3DArray is not None and self._vision.get_subscription_count():
            self._vision.publish(to_detections(messages))
        if not self._has_tracks:
            self._draw(messages)

    def _draw(self, messages: Sequence[MarkerDetection | MarkerTrack]) -> None:
        if self._drawn.get_subscription_count():
            stale_after_s = self._values['stale_after']
            shapes = [shape for one in messages for shape in marker_shapes(one, stale_after_s)]
            self._drawn.publish(MarkerArray(markers=shapes))


def to_detections(messages: list[MarkerDetection]) -> Any:
    """Return detections of one frame as a `vision_msgs/Detection3DArray`.

    The class of a hypothesis is the ID, and its score the correlation with the sent packet.
    """
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
