# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a detector: detections, tracks, their transforms, and standard messages."""

import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.detector import Detection, Detector
from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.detection import MAX_TRACKS
from retrolidar_ros.marker.known_markers import KnownMarker, frame_of
from retrolidar_ros.msg import MarkerDetection, MarkerDetectionArray, MarkerTrack
from retrolidar_ros.nodes.conversion import (
    Marked,
    to_detection_msg,
    to_header,
    to_track_msg,
    to_transform,
)
from retrolidar_ros.nodes.parameters import NAME
from retrolidar_ros.nodes.qos import EVENTS, latched, publisher, topics_of
from retrolidar_ros.nodes.transforms import TransformSender
from retrolidar_ros.nodes.visualization import marker_shapes
from retrolidar_ros.sensor.frame import Frame

try:
    from vision_msgs.msg import Detection3D, Detection3DArray, ObjectHypothesisWithPose
except ImportError:  # not installed: no subscribers
    Detection3DArray = None
_MAX_POSES = 100
_BEAT_PERIOD_S = 0.2
_SHAPE_PERIOD_NS = 60_000_000  # of tracks
_EARLY = 0.9  # of a period, as frames jitter


class DetectorTopics:
    """The topics of detections and tracks, shapes, `poses/NAME`, and TF."""

    def __init__(
        self,
        node: Node,
        known: Mapping[int, KnownMarker],
        values: dict[str, Any],
        sender: TransformSender,
    ) -> None:
        """Make the publishers; names of markers are those of `known`."""
        self._sender = sender
        self._node = node
        self._known = known
        self._markers = publisher(node, MarkerDetection, 'markers', EVENTS)
        self._arrays = publisher(node, MarkerDetectionArray, 'markers_array', EVENTS)
        self._tracks = publisher(node, MarkerTrack, 'tracks', EVENTS)
        self._drawn = publisher(node, MarkerArray, 'marker_array', EVENTS)
        if Detection3DArray is not None:
            self._vision = publisher(node, Detection3DArray, 'detections', EVENTS)
        self._heartbeat = node.create_publisher(Header, '~/heartbeat', 10)
        if len(known) > _MAX_POSES:
            node.get_logger().warning(
                f'{len(known)} known markers: no topic poses/NAME for more than {_MAX_POSES}'
            )
            known = {}
        topics = topics_of('poses/', [marker.frame for marker in known.values()])
        self._poses = {
            marker.id: latched(node, PoseStamped, topics[marker.frame]) for marker in known.values()
        }
        self._beat_s = -math.inf
        self._sent_ns = self._drawn_ns = self._dropped = 0
        self.change(values)

    def change(self, values: dict[str, Any]) -> None:
        """Apply new parameters."""
        self._values = values
        # Whether transforms and shapes are of tracks, which method paper has not.
        self._has_tracks = values['tf_source'] == 'tracks' and values['method'] == 'joint'
        if values['publish_tf']:
            self._sender.open()

    def beat(self, stamp_ns: int, frame_id: str) -> None:
        """Publish, several times a second, the stamp up to which all frames are searched."""
        # By the steady clock: this node lives even if the stamps stand still.
        if (now_s := time.monotonic()) - self._beat_s >= _BEAT_PERIOD_S:
            self._beat_s = now_s
            self._heartbeat.publish(to_header(stamp_ns, frame_id))

    def follow(self, detector: Detector, agreement: Agreement, frame: Frame, frame_id: str) -> None:
        """Publish the tracks at a frame, if there are subscribers or parameters ask for them."""
        has_subscribers = self._tracks.get_subscription_count() > 0
        if not (self._has_tracks or has_subscribers):
            return
        tracks = agreement.followed(detector.follow(frame))
        self._warn_of_dropped(detector.counts.tracks_dropped)
        if not tracks or not self._is_due(frame.stamp_ns):
            return
        messages = [to_track_msg(track, frame_id, self._child_frame(track.id)) for track in tracks]
        if self._has_tracks:
            self._send(messages)
        if has_subscribers:
            for message in messages:
                self._tracks.publish(message)
        if self._has_tracks and abs(frame.stamp_ns - self._drawn_ns) >= _SHAPE_PERIOD_NS:
            self._drawn_ns = frame.stamp_ns
            self._draw(messages)

    def _is_due(self, stamp_ns: int) -> bool:
        max_rate_hz = self._values['max_track_rate']
        if max_rate_hz and abs(stamp_ns - self._sent_ns) < _EARLY * 1e9 / max_rate_hz:
            return False
        self._sent_ns = stamp_ns
        return True

    def _warn_of_dropped(self, dropped: int) -> None:
        if dropped > self._dropped:
            self._node.get_logger().warning(
                f'more than {MAX_TRACKS} markers: {dropped} tracks were dropped, '
                'the least certain ones',
                throttle_duration_sec=5.0,
            )
        self._dropped = dropped

    def _child_frame(self, identity: int) -> str:
        name = frame_of(identity, self._known)
        return str(self._values['child_frame']).replace(NAME, name)

    def publish(self, detections: list[Detection], stamp_ns: int, frame_id: str) -> None:
        """Publish the detections of one frame, transforms first: subscribers look them up."""
        child = self._child_frame
        messages = [to_detection_msg(one, frame_id, child(one.id)) for one in detections]
        if not self._has_tracks:
            self._send(messages)
        for message in messages:
            self._markers.publish(message)
            if message.id in self._poses:
                pose = PoseStamped(header=message.header, pose=message.pose.pose)
                self._poses[message.id].publish(pose)
        if self._arrays.get_subscription_count():
            self._arrays.publish(to_array(to_header(stamp_ns, frame_id), messages))
        if Detection3DArray is not None and self._vision.get_subscription_count():
            self._vision.publish(to_detections(messages))
        if not self._has_tracks:
            self._draw(messages)

    def _send(self, messages: Sequence[Marked]) -> None:
        if self._values['publish_tf']:
            self._sender.send(
                [
                    to_transform(message.header, message.child_frame_id, message.pose.pose)
                    for message in messages
                ]
            )

    def _draw(self, messages: Sequence[Marked]) -> None:
        if self._drawn.get_subscription_count():
            stale_after_s = self._values['stale_after']
            shapes = [shape for one in messages for shape in marker_shapes(one, stale_after_s)]
            self._drawn.publish(MarkerArray(markers=shapes))


def to_array(header: Header, messages: list[MarkerDetection]) -> MarkerDetectionArray:
    """Return the detections of the frame of a header as one message."""
    return MarkerDetectionArray(header=header, detections=messages)


def to_detections(messages: list[MarkerDetection]) -> Any:
    """Return detections of one frame as a `vision_msgs/Detection3DArray`; a class is an ID."""
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
