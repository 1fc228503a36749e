# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Read liquid-crystal fiducial markers with a thumbnail-sized LiDAR.

Without ROS, from a bag to detections::

    from retrolidar_ros.bag import read_frames
    from retrolidar_ros.detector import create_detector
    from retrolidar_ros.sensor.frame import Recording

    recording = Recording.of(list(read_frames('my_bag')))
    for detection in create_detector('joint', recording.grid).update_all(recording):
        print(detection.id, detection.place.position_m)

The nodes are in `retrolidar_ros.nodes`, the messages in `retrolidar_ros.msg`.
"""
