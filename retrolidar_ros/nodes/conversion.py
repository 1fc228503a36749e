# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames and detections to and from ROS messages."""

from array import array
from typing import Any, TypeAlias

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseWithCovariance, PoseWithCovarianceStamped, TransformStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import Header

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.detection import Place, Track
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.sensor.frame import Floats, Frame, ZoneGrid, valid_samples
from retrolidar_ros.sensor.rotation import matrix_of, quaternion_of

Marked: TypeAlias = 'MarkerDetection | MarkerTrack'  # a message with the place of a marker
_ANY_TURN_RATE = 3.0  # deviation of a marker's rate of turn, which is not measured [rad/s]
# Of a detection, what a message has as it is, by the fields of both.
_ALIKE = ('id', 'evidence', 'decision_margin', 'score', 'likelihood', 'corrected_bits', 'packets')
_MEASURED = {name: name for name in _ALIKE} | {'snr_db': 'snr', 'bit_period_s': 'bit_period'}
_POINT_FIELDS = ('x', 'y', 'z', 'signal', 'ambient')


def to_time(stamp_ns: int) -> Time:
    """Return nanoseconds as a ROS time."""
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return Time(sec=seconds, nanosec=nanoseconds)


def to_ns(time: Time) -> int:
    """Return a ROS time in nanoseconds."""
    return int(time.sec) * 1_000_000_000 + int(time.nanosec)


def vector_of(message: Any) -> Floats:
    """Return a point or a vector as an array, shape (3,)."""
    return np.array([message.x, message.y, message.z])


def quaternion_in(message: Any) -> Floats:
    """Return a quaternion (x, y, z, w) as an array, shape (4,)."""
    return np.array([message.x, message.y, message.z, message.w])


def covariance_of(pose: PoseWithCovariance) -> Floats:
    """Return the covariance of a pose, shape (6, 6)."""
    return np.array(pose.covariance).reshape(6, 6)


def to_pose(position_m: Floats, quaternion: Floats) -> Pose:
    """Return a pose of a position, shape (3,) [m], and a quaternion (x, y, z, w)."""
    pose = Pose()
    pose.position.x, pose.position.y, pose.position.z = position_m.tolist()
    orientation = pose.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = quaternion.tolist()
    return pose


def from_pose(pose: Pose) -> tuple[Floats, Floats]:
    """Return the position, shape (3,) [m], and the rotation matrix of a pose."""
    return vector_of(pose.position), matrix_of(quaternion_in(pose.orientation))


def to_header(stamp_ns: int, frame_id: str) -> Header:
    """Return a header of a time and a frame."""
    return Header(stamp=to_time(stamp_ns), frame_id=frame_id)


def to_frame_msg(frame: Frame, frame_id: str) -> FrameMsg:
    """Return a frame as a message, its stamp and arrays as they are."""
    message = FrameMsg(header=to_header(frame.stamp_ns, frame_id))
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
    """Return the frame of a message; ValueError for zones or arrays of an impossible shape."""
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
    frame.check()
    return frame


def to_point_cloud(frame: Frame, frame_id: str) -> PointCloud2:
    """Return a point on the axis of each zone, in rows and columns; NaN of no target."""
    grid = frame.grid
    depth = _depth(frame)
    points = np.column_stack([grid.tangents * depth[:, None], depth, frame.signal, frame.ambient])
    fields = [
        PointField(name=name, offset=4 * index, datatype=PointField.FLOAT32, count=1)
        for index, name in enumerate(_POINT_FIELDS)
    ]
    return PointCloud2(
        header=to_header(frame.stamp_ns, frame_id),
        height=grid.rows,
        width=grid.columns,
        fields=fields,
        is_bigendian=False,
        point_step=4 * len(_POINT_FIELDS),
        row_step=4 * len(_POINT_FIELDS) * grid.columns,
        data=array('B', points.astype('<f4').tobytes()),
        is_dense=bool(np.isfinite(depth).all()),
    )


def to_signal_image(frame: Frame, frame_id: str) -> Image:
    """Return the signal of each zone [kcps/SPAD] as an image of floats, 32FC1."""
    return _image(frame, frame.signal, frame_id)


def to_depth_image(frame: Frame, frame_id: str) -> Image:
    """Return the distance of each zone along the optical axis [m], 32FC1, NaN of no target."""
    return _image(frame, _depth(frame), frame_id)


def to_camera_info(frame: Frame, frame_id: str) -> CameraInfo:
    """Return the sensor as a pinhole camera: its zones are equal steps of a tangent."""
    grid = frame.grid
    focal = 1 / grid.pitch  # [zones]
    middle = (grid.columns - 1) / 2, (grid.rows - 1) / 2
    info = CameraInfo(
        header=to_header(frame.stamp_ns, frame_id), height=grid.rows, width=grid.columns
    )
    info.distortion_model, info.d = 'plumb_bob', [0.0] * 5
    info.k = [focal, 0.0, middle[0], 0.0, focal, middle[1], 0.0, 0.0, 1.0]
    info.r = np.eye(3).ravel().tolist()
    info.p = [focal, 0.0, middle[0], 0.0, 0.0, focal, middle[1], 0.0, 0.0, 0.0, 1.0, 0.0]
    return info


def _depth(frame: Frame) -> NDArray[np.float32]:
    """Return the valid distances [m], NaN for the others."""
    valid, _ = valid_samples(frame.signal, frame.distance, frame.status)
    return np.where(valid, frame.distance, np.nan).astype(np.float32)


def _image(frame: Frame, values: Floats, frame_id: str) -> Image:
    return Image(
        header=to_header(frame.stamp_ns, frame_id),
        height=frame.grid.rows,
        width=frame.grid.columns,
        encoding='32FC1',
        is_bigendian=0,
        step=4 * frame.grid.columns,
        data=array('B', values.astype('<f4').tobytes()),
    )


def to_detection_msg(detection: Detection, frame_id: str, child_frame_id: str) -> MarkerDetection:
    """Return a detection as a message in the sensor's frame `frame_id`."""
    message = MarkerDetection(header=to_header(detection.stamp_ns, frame_id))
    message.child_frame_id = child_frame_id
    _set_place(message, detection.place)
    for name, field in _MEASURED.items():
        setattr(message, field, getattr(detection, name))
    message.zones = array('B', detection.zones)
    message.start = to_time(detection.start_ns)
    message.end = to_time(detection.end_ns)
    return message


def from_detection_msg(message: MarkerDetection) -> Detection:
    """Return the detection of a message."""
    pose = message.pose.pose
    return Detection(
        stamp_ns=to_ns(message.header.stamp),
        start_ns=to_ns(message.start),
        end_ns=to_ns(message.end),
        place=Place(
            vector_of(pose.position),
            quaternion_in(pose.orientation),
            covariance_of(message.pose),
            message.range,
            message.range_stddev,
        ),
        zones=tuple(message.zones),
        **{name: getattr(message, field) for name, field in _MEASURED.items()},
    )


def to_track_msg(track: Track, frame_id: str, child_frame_id: str) -> MarkerTrack:
    """Return a track as a message in the sensor's frame `frame_id`."""
    message = MarkerTrack(header=to_header(track.stamp_ns, frame_id))
    message.child_frame_id = child_frame_id
    message.id = track.id
    _set_place(message, track.place)
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = track.velocity.tolist()
    covariance = np.diag(np.full(6, _ANY_TURN_RATE**2))
    covariance[:3, :3] = track.velocity_covariance
    message.twist.covariance = covariance.ravel()
    message.presence = track.presence
    message.first = to_time(track.first_ns)
    message.last = to_time(track.last_ns)
    return message


def _set_place(message: Marked, place: Place) -> None:
    message.pose.pose = to_pose(place.position_m, place.orientation)
    message.pose.covariance = place.covariance.ravel()
    message.range = place.range_m
    message.range_stddev = place.range_stddev_m


def to_transform(header: Header, child_frame_id: str, pose: Pose) -> TransformStamped:
    """Return the transform from a frame to another one that has a pose there."""
    transform = TransformStamped(header=header, child_frame_id=child_frame_id)
    translation = transform.transform.translation
    translation.x, translation.y, translation.z = pose.position.x, pose.position.y, pose.position.z
    transform.transform.rotation = pose.orientation
    return transform


def to_pose_msg(
    header: Header, position_m: Floats, rotation: Floats, covariance: Floats
) -> PoseWithCovarianceStamped:
    """Return a pose: position, shape (3,) [m], rotation (3, 3), covariance (6, 6)."""
    message = PoseWithCovarianceStamped(header=header)
    message.pose.pose = to_pose(position_m, quaternion_of(rotation))
    message.pose.covariance = covariance.ravel()
    return message
