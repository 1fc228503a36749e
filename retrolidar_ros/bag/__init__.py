# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Read and write frames in rosbag2 bags without ROS; only writing needs the library `rosbags`."""

from retrolidar_ros.bag.messages import FRAME_TYPE, BagError
from retrolidar_ros.bag.reader import FRAMES_TOPIC, read_frames, salvage_frames
from retrolidar_ros.bag.writer import STORAGES, FrameWriter

__all__ = [
    'FRAMES_TOPIC',
    'FRAME_TYPE',
    'STORAGES',
    'BagError',
    'FrameWriter',
    'read_frames',
    'salvage_frames',
]
