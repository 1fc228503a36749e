# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The topic `tracks`, and what follows markers from frame to frame: their transforms and shapes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

from rclpy.node import Node

from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.tracks import MAX_TRACKS, Track
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import to_track_msg
from retrolidar_ros.nodes.qos import EVENTS, publisher
from retrolidar_ros.sensor.frame import Frame

Marked: TypeAlias = 'MarkerDetection | MarkerTrack'
"""A message with the place of a marker."""
_SHAPE_PERIOD_NS = 60_000_000
_EARLY = 0.9  # of a period, as frames jitter


class TrackTopics:
    """Publishes tracks while there are subscribers."""

    def __init__(
        self,
        node: Node,
        child_frame: Callable[[int], str],
        send: Callable[[Sequence[Marked]], None],
        draw: Callable[[Sequence[Marked]], None],
    ) -> None:
        """Make the publisher; `child_frame` names a marker's TF frame, `send` sends transforms."""
        self._node = node
        self._child_frame = child_frame
        self._send = send
        self._draw = draw
        self._tracks = publisher(node, MarkerTrack, 'tracks', EVENTS)
        self._sent_ns = self._drawn_ns = 0
        self._dropped = 0

    def follow(
        self,
        detector: LikelihoodDetector,
        agreement: Agreement,
        frame: Frame,
        frame_id: str,
        values: dict[str, Any],
    ) -> None:
        """Publish the tracks at the newest frame, if there are subscribers."""
        leads = values['tf_source'] == 'tracks'
        has_subscribers = self._tracks.get_subscription_count() > 0
        if not leads and not has_subscribers:
            return
        tracks = agreement.followed(detector.follow(frame))
        self._warn_of_dropped(detector.track_counts.dropped)
        if not tracks or not self._is_due(frame.stamp_ns, values['max_track_rate']):
            return
        messages = [self._message(track, frame_id) for track in tracks]
        if leads:
            self._send(messages)
        if has_subscribers:
            for message in messages:
                self._tracks.publish(message)
        if leads and abs(frame.stamp_ns - self._drawn_ns) >= _SHAPE_PERIOD_NS:
            self._drawn_ns = frame.stamp_ns
            self._draw(messages)

    def _message(self, track: Track, frame_id: str) -> MarkerTrack:
        return to_track_msg(track, frame_id, self._child_frame(track.id))

    def _is_due(self, stamp_ns: int, max_rate_hz: float) -> bool:
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
