# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `driver` node: from the serial port to `frames`, `points` and `signal_image`."""

from __future__ import annotations

import time
from dataclasses import replace
from threading import Event, Thread
from typing import Any, NamedTuple

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image, PointCloud2

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_frame_msg, to_point_cloud, to_signal_image
from retrolidar_ros.nodes.diagnostics import ERROR, OK, WARN, Health, publish_health
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.run import run
from retrolidar_ros.sensor.clock import ClockMap
from retrolidar_ros.sensor.frame import NORMAL_STATUS, Frame
from retrolidar_ros.sensor.frame_rate import missing_frames
from retrolidar_ros.sensor.protocols import PROTOCOLS
from retrolidar_ros.sensor.serial_source import SerialSource

# Share of abnormal zones from which on something is wrong with the sensor or before it: looking
# into a room, a quarter of them is usual.
_MANY_ABNORMAL = 0.75


class _Tally(NamedTuple):
    """What has been counted until some time."""

    time_s: float
    frames: int = 0
    damaged: int = 0
    received: int = 0
    withheld: int = 0
    lost: int = 0
    zones: int = 0
    abnormal: int = 0
    latency_s: float = 0.0
    """Sum over the frames, from the middle of the exposure until they were published."""


class DriverNode(Node):
    """Publishes the sensor's frames with the time of their exposure.

    The port is read in a thread of its own, so nothing that the executor does delays a frame.
    """

    def __init__(self) -> None:
        """Declare parameters and start to read."""
        super().__init__('driver')
        self.failed = False
        """Whether reading has ended by an error that nobody expected."""
        parameters = Parameters(self, 'driver')
        parameters.text('serial_port', 'Device of the sensor; a path under by-id is best.')
        parameters.integer('serial_baud', 'Speed of the line [bit/s].', 9600, 12_000_000)
        parameters.text('protocol', 'What the sensor speaks.', tuple(PROTOCOLS))
        parameters.text('frame_id', 'TF frame of the sensor: x right, y down, z forward.')
        parameters.number(
            'transport_delay',
            'Least time from the middle of an exposure to the arrival of its frame [s].',
            0.0,
            1.0,
            live=True,
        )
        parameters.warn_of_unknown()
        values = parameters.values
        self._frame_id = values['frame_id']
        if not self._frame_id:
            raise ValueError('frame_id is empty; TF needs a name')
        self._clock_map = ClockMap(values['transport_delay'])
        parameters.follow(self._change)
        reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._publisher = self.create_publisher(FrameMsg, 'frames', reliable)
        self._points = self.create_publisher(PointCloud2, 'points', reliable)
        self._image = self.create_publisher(Image, 'signal_image', reliable)
        reader = PROTOCOLS[values['protocol']](self._now_ns)
        self._source = SerialSource(
            values['serial_port'], values['serial_baud'], reader, self._now_ns
        )
        self._last_sequence: int | None = None
        self._tally = self._examined = _Tally(time.monotonic())
        publish_health(self, 'frames', values['serial_port'], self._examine)
        self._stop = Event()
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Close the port, then the node."""
        self._stop.set()
        self._thread.join()
        super().destroy_node()

    def _now_ns(self) -> int:
        """Return ROS time: with use_sim_time that of /clock, 0 until it ticks."""
        return int(self.get_clock().now().nanoseconds)

    def _change(self, values: dict[str, Any]) -> None:
        self._clock_map.set_least_delay(values['transport_delay'])

    def _read(self) -> None:
        """Read until the node ends, whichever of the two ends first."""
        try:
            self._source.run(self._publish, self._report, self._stop)
        except Exception as error:
            # A request to end invalidates the publisher before this thread hears of it.
            if rclpy.ok():
                self.failed = True
                self.get_logger().fatal(f'reading has failed: {error!r}')
                rclpy.try_shutdown()

    def _report(self, line: str) -> None:
        if self._source.is_open:
            self.get_logger().info(line)
        else:
            self.get_logger().warning(line)

    def _publish(self, frames: list[Frame], arrival_ns: int) -> None:
        if not arrival_ns:
            self.get_logger().warning(
                'use_sim_time is set, but nobody publishes /clock: frames are dropped',
                throttle_duration_sec=5.0,
            )
            return
        for frame in frames:
            stamp_ns = self._clock_map.map(frame.sensor_time_us, arrival_ns)
            if stamp_ns < 0:  # exposed before a simulated clock began
                continue
            message = to_frame_msg(replace(frame, stamp_ns=stamp_ns), self._frame_id)
            self._publisher.publish(message)
            if self._points.get_subscription_count():
                self._points.publish(to_point_cloud(frame, message.header))
            if self._image.get_subscription_count():
                self._image.publish(to_signal_image(frame, message.header))
            self._count(frame, self._now_ns() - stamp_ns)
        if notice := self._source.reader.notice():
            self.get_logger().warning(notice)

    def _count(self, frame: Frame, latency_ns: int) -> None:
        tally = self._tally
        missing = missing_frames(self._last_sequence, frame.sequence)
        self._last_sequence = frame.sequence
        normal = int(np.count_nonzero(np.isin(frame.status, NORMAL_STATUS)))
        # One assignment, for the executor reads it in another thread.
        self._tally = tally._replace(
            frames=tally.frames + 1,
            lost=tally.lost + missing,
            zones=tally.zones + frame.grid.zones,
            abnormal=tally.abnormal + frame.grid.zones - normal,
            latency_s=tally.latency_s + latency_ns * 1e-9,
        )

    def _examine(self) -> Health:
        """Judge the last second."""
        counts = self._source.reader.counts
        now = self._tally._replace(
            time_s=time.monotonic(),
            damaged=counts.damaged,
            received=self._source.received,
            withheld=counts.withheld,
        )
        then, self._examined = self._examined, now
        frames = now.frames - then.frames
        rate = frames / (now.time_s - then.time_s)
        damaged, lost = now.damaged - then.damaged, now.lost - then.lost
        abnormal = (now.abnormal - then.abnormal) / max(now.zones - then.zones, 1)
        latency_ms = 1e3 * (now.latency_s - then.latency_s) / max(frames, 1)
        values = {
            'port': self._source.port,
            'frame rate [Hz]': f'{rate:.1f}',
            'frames': str(now.frames),
            'lost frames': str(now.lost),
            'abnormal zones [%]': f'{100 * abnormal:.1f}',
            'latency [ms]': f'{latency_ms:.1f}',
            'packets with CRC errors': str(counts.bad_crc),
            'packets with framing errors': str(counts.bad_framing + counts.overlong),
            'packets of a wrong shape': str(counts.bad_shape),
            'packets of an unknown kind': str(counts.unknown_kind),
            'openings of the port': str(self._source.openings),
            'clock offset [s]': f'{self._clock_map.offset_s:.6f}',
            'clock skew [ppm]': f'{self._clock_map.skew * 1e6:.0f}',
            'clock restarts': str(self._clock_map.restarts),
        }
        if not self._source.is_open:
            return Health(ERROR, self._source.problem, values)
        if not frames:
            return Health(ERROR, _silence(then, now), values)
        if damaged or lost:
            return Health(WARN, f'{damaged} damaged packets, {lost} lost frames', values)
        if abnormal > _MANY_ABNORMAL:
            return Health(WARN, f'{100 * abnormal:.0f} % of the zones are abnormal', values)
        return Health(OK, f'{rate:.1f} frames a second', values)


def _silence(then: _Tally, now: _Tally) -> str:
    """Say that no frames have come since `then`, and what came instead."""
    silence = 'the port is open, but no frames come'
    if now.withheld > then.withheld:
        return f'{silence} with signal, which the sensor has been asked for'
    if received := now.received - then.received:
        return f'{silence}, though {received} bytes did: another serial_baud or protocol?'
    return silence


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(DriverNode)
