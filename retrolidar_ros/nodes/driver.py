# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `driver` node: from the serial port to `frames`."""

from __future__ import annotations

import time
from dataclasses import replace
from threading import Event, Thread

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from retrolidar_ros.clock import ClockMap
from retrolidar_ros.frame import Frame
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_frame_msg
from retrolidar_ros.nodes.diagnostics import ERROR, OK, WARN, Health, publish_health
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.run import run
from retrolidar_ros.serial_source import SerialSource

_COUNTER = 2**32


class DriverNode(Node):
    """Publishes the sensor's frames with the time of their exposure.

    The port is read in a thread of its own, so nothing that the executor does delays a frame.
    """

    def __init__(self) -> None:
        """Declare parameters and start to read."""
        super().__init__('driver')
        parameters = Parameters(self, 'driver')
        port = parameters.text('serial_port', 'Device of the sensor; a path under by-id is best.')
        baud = parameters.integer('serial_baud', 'Speed of the line [bit/s].', 9600, 12_000_000)
        self._frame_id = parameters.text(
            'frame_id', 'TF frame of the sensor: x right, y down, z forward.'
        )
        transport_delay = parameters.number(
            'transport_delay',
            'Least time from the middle of an exposure to the arrival of its frame [s].',
            0.0,
            1.0,
        )
        parameters.warn_of_unknown()
        if not self._frame_id:
            raise ValueError('frame_id is empty; TF needs a name')
        self._publisher = self.create_publisher(
            FrameMsg, 'frames', QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        )
        self._clock_map = ClockMap(transport_delay)
        self._source = SerialSource(port, baud)
        self._last_sequence: int | None = None
        self._lost = 0
        self._examined = (time.monotonic(), 0, 0, 0)
        publish_health(self, 'frames', port, self._examine)
        self._stop = Event()
        self._thread = Thread(target=self._read, daemon=True)
        self._thread.start()

    def destroy_node(self) -> None:
        """Close the port, then the node."""
        self._stop.set()
        self._thread.join()
        super().destroy_node()

    def _read(self) -> None:
        """Read until the node ends, whichever of the two ends first."""
        try:
            self._source.run(self._publish, self._report, self._stop)
        except Exception as error:
            # A request to end invalidates the publisher before this thread hears of it.
            if rclpy.ok():
                self.get_logger().fatal(f'reading has failed: {error!r}')
                rclpy.try_shutdown()

    def _report(self, line: str) -> None:
        if self._source.is_open:
            self.get_logger().info(line)
        else:
            self.get_logger().warning(line)

    def _publish(self, frames: list[Frame], arrival_ns: int) -> None:
        for frame in frames:
            self._count_lost(frame.sequence)
            stamp_ns = self._clock_map.map(frame.sensor_time_us, arrival_ns)
            message = to_frame_msg(replace(frame, stamp_ns=stamp_ns), self._frame_id)
            self._publisher.publish(message)

    def _count_lost(self, sequence: int) -> None:
        if self._last_sequence is not None:
            missed = (sequence - self._last_sequence - 1) % _COUNTER
            # A counter that went back is a sensor that restarted, not four billion lost frames.
            if missed < _COUNTER // 2:
                self._lost += missed
        self._last_sequence = sequence

    def _examine(self) -> Health:
        """Judge the last second."""
        counts = self._source.reader.counts
        now = time.monotonic()
        then, frames_then, damaged_then, lost_then = self._examined
        self._examined = (now, counts.frames, counts.damaged, self._lost)
        rate = (counts.frames - frames_then) / (now - then)
        damaged, lost = counts.damaged - damaged_then, self._lost - lost_then
        values = {
            'port': self._source.port,
            'frame rate [Hz]': f'{rate:.1f}',
            'frames': str(counts.frames),
            'lost frames': str(self._lost),
            'packets with CRC errors': str(counts.bad_crc),
            'packets with framing errors': str(counts.bad_framing + counts.overlong),
            'packets of a wrong shape': str(counts.bad_shape),
            'packets of an unknown kind': str(counts.unknown_kind),
            'openings of the port': str(self._source.openings),
            'clock skew [ppm]': f'{self._clock_map.skew * 1e6:.0f}',
            'clock restarts': str(self._clock_map.restarts),
        }
        if not self._source.is_open:
            return Health(ERROR, self._source.problem, values)
        if rate == 0:
            return Health(ERROR, 'the port is open, but no frames come', values)
        if damaged or lost:
            return Health(WARN, f'{damaged} damaged packets, {lost} lost frames', values)
        return Health(OK, f'{rate:.1f} frames a second', values)


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(DriverNode)
