# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Publish the frames of a bag as a driver would, without rosbag2."""

import argparse
import time
from contextlib import suppress
from itertools import chain

from retrolidar_ros.bag import read_frames
from retrolidar_ros.cli.arguments import add_bag
from retrolidar_ros.settings.interrupts import interrupted_once
from retrolidar_ros.settings.parameter import declared

HELP = 'publish the frames of a bag to ROS'
DESCRIPTION = 'Keeps the recorded stamps, and publishes no /clock. Needs ROS 2, but not rosbag2.'
_DISCOVERY_S = 3.0  # until there is a subscriber, or not


def rate(text: str) -> float:
    """Parse a replay rate."""
    with suppress(ValueError):
        if 0 < (value := float(text)) <= 1000:
            return value
    raise argparse.ArgumentTypeError(f'{text} is no rate: more than 0, and up to 1000')


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_bag(command)
    command.add_argument(
        '--to', metavar='TOPIC', help='topic to publish to (default: as in the bag)'
    )
    command.add_argument('--rate', type=rate, default=1.0, help='factor of the speed (default: 1)')
    command.add_argument('--loop', action='store_true', help='begin again at the end')
    command.add_argument('--frame-id', help="TF frame of the sensor (default: the driver's)")


def run(arguments: argparse.Namespace) -> int:
    """Publish frames at their times until the bag ends, or Ctrl-C."""
    try:
        import rclpy
        from rclpy.duration import Duration
        from rclpy.exceptions import NameValidationException
        from rclpy.node import Node
        from rclpy.signals import SignalHandlerOptions

        from retrolidar_ros.msg import Frame as FrameMsg
        from retrolidar_ros.nodes.conversion import to_frame_msg
        from retrolidar_ros.nodes.qos import FRAME_QOS, publisher
    except ImportError as error:
        raise ValueError(f'replay needs ROS 2 and this package built for it: {error}') from error
    frame_id = arguments.frame_id or declared()['driver']['frame_id'].default
    frames = read_frames(arguments.bag, arguments.topic)
    first = next(frames)  # an unreadable bag is reported at once
    name = arguments.to or arguments.topic
    sent = 0
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node('replay')
        try:
            topic = publisher(node, FrameMsg, name, FRAME_QOS)
        except NameValidationException as error:
            raise ValueError(f'--to: {str(error).splitlines()[0]} {name}') from error
        with suppress(KeyboardInterrupt), interrupted_once():
            until_s = time.monotonic() + _DISCOVERY_S
            while not topic.get_subscription_count() and time.monotonic() < until_s:
                time.sleep(0.05)
            print(f'playing {arguments.bag} to {name}', flush=True)
            while True:
                begin_s = time.monotonic()
                for frame in chain([first], frames):
                    due_s = begin_s + (frame.stamp_ns - first.stamp_ns) * 1e-9 / arguments.rate
                    time.sleep(max(due_s - time.monotonic(), 0.0))
                    topic.publish(to_frame_msg(frame, frame_id))
                    sent += 1
                if not arguments.loop:
                    break
                frames = read_frames(arguments.bag, arguments.topic)
                first = next(frames)
            topic.wait_for_all_acked(Duration(seconds=1))
        print(f'{sent} frames to {name}')
    finally:
        rclpy.try_shutdown()
    return 0
