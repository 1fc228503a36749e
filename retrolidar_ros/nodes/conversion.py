# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames and detections to and from ROS messages."""

from __future__ import annotations

from array import array

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped

from retrolidar_ros.detector import Detection
from retrolidar_ros.frame import Frame, ZoneGrid, check_frame_arrays
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection


def to_time(stamp_ns: int) -> Time:
    """Return nanoseconds as a ROS time."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_ns(time: Time) -> int:
    """Return a ROS time in nanoseconds."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def to_frame_msg(frame: Frame, frame_id: str) -> FrameMsg:
    """Return a frame as a message, its stamp and arrays as they are."""
    message = FrameMsg()
    message.header.stamp = to_time(frame.stamp_ns)
    message.header.frame_id = frame_id
    message.sequence = frame.sequence
    message.sensor_time = frame.sensor_time_us
    message.rows = frame.grid.rows
    message.columns = frame.grid.columns
    # Typed arrays pass through the setters without a check of every element.
    message.distance = array('f', frame.distance.tobytes())
    message.signal = array('f', frame.signal.tobytes())
    message.ambient = array('f', frame.ambient.tobytes())
    message.status = array('B', frame.status.tobytes())
    return message


def from_frame_msg(message: FrameMsg) -> Frame:
    """Return the frame of a message.

    Raises
    ------
    ValueError
        If the zones are not of a shape that the sensor has, or an array has another length.
    """
    frame = Frame(
        stamp_ns=to_ns(message.header.stamp),
        sequence=message.sequence,
        sensor_time_us=message.sensor_time,
        grid=ZoneGrid(message.rows, message.columns),
        distance=np.asarray(message.distance, dtype=np.float32),
        signal=np.asarray(message.signal, dtype=np.float32),
        ambient=np.asarray(message.ambient, dtype=np.float32),
        status=np.asarray(message.status, dtype=np.uint8),
    )
    check_frame_arrays(
        frame.grid,
        distance=frame.distance,
        signal=frame.signal,
        ambient=frame.ambient,
        status=frame.status,
    )
    return frame


def to_detection_msg(detection: Detection, frame_id: str, child_frame_id: str) -> MarkerDetection:
    """Return a detection as a message in the sensor's frame `frame_id`."""
    message = MarkerDetection()
    message.header.stamp = to_time(detection.stamp_ns)
    message.header.frame_id = frame_id
    message.child_frame_id = child_frame_id
    message.id = detection.id
    place = detection.place
    position, orientation = message.pose.pose.position, message.pose.pose.orientation
    position.x, position.y, position.z = place.position_m.tolist()
    orientation.x, orientation.y, orientation.z, orientation.w = place.orientation.tolist()
    message.pose.covariance = place.covariance.ravel()
    message.range = place.range_m
    message.range_stddev = place.range_stddev_m
    message.snr = detection.snr_db
    message.score = detection.score
    message.likelihood = detection.likelihood
    message.corrected_bits = detection.corrected_bits
    message.packets = detection.packets
    message.zones = array('B', detection.zones)
    message.start = to_time(detection.start_ns)
    return message


def to_transform(message: MarkerDetection) -> TransformStamped:
    """Return the transform from the sensor's frame to the marker's of a detection."""
    transform = TransformStamped()
    transform.header = message.header
    transform.child_frame_id = message.child_frame_id
    position = message.pose.pose.position
    translation = transform.transform.translation
    translation.x, translation.y, translation.z = position.x, position.y, position.z
    transform.transform.rotation = message.pose.pose.orientation
    return transform
