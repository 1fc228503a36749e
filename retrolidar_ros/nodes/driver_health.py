# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The counters of a driver, its health over the last second, and whether its detector lives."""

import time
from typing import NamedTuple

import numpy as np
from rclpy.node import Node
from std_msgs.msg import Header

from retrolidar_ros.nodes.diagnostics import ERROR, WARN, Health
from retrolidar_ros.sensor.clock import ClockMap
from retrolidar_ros.sensor.frame import IS_NORMAL, Frame, missing_frames, stamps_stand
from retrolidar_ros.sensor.serial_source import SerialSource
from retrolidar_ros.sensor.wire import WireCounts

_MANY_ABNORMAL = 0.75  # share of zones of a faulty sensor; into a room, a quarter is usual
_SILENCE_S = 0.8
NO_CLOCK = 'use_sim_time is set, but nobody publishes /clock: frames are dropped'


class _Counts(NamedTuple):
    frames: int = 0
    lost: int = 0
    damaged: int = 0
    untimed: int = 0
    zones: int = 0
    normal: int = 0
    late_ns: int = 0  # sum over the frames, from mid-exposure until they were published
    stamp_ns: int = 0  # of the newest frame


class DriverTally:
    """Counts frames in one thread, and is examined in another."""

    def __init__(self) -> None:
        self._counts = self._then = _Counts()
        self._received, self._examined_s = WireCounts(), time.monotonic()
        self._last_sequence: int | None = None

    def count(self, frame: Frame, latency_ns: int) -> None:
        """Count a stamped frame, published so long after the middle of its exposure."""
        counts = self._counts
        # Set in one step, as a frame that is counted by half has abnormal zones.
        self._counts = counts._replace(
            frames=counts.frames + 1,
            lost=counts.lost + missing_frames(self._last_sequence, frame.sequence),
            zones=counts.zones + len(frame.status),
            normal=counts.normal + int(np.count_nonzero(IS_NORMAL[frame.status])),
            late_ns=counts.late_ns + latency_ns,
            stamp_ns=frame.stamp_ns,
        )
        self._last_sequence = frame.sequence

    def count_untimed(self, frames: int) -> None:
        """Count frames that came before the clock did."""
        self._counts = self._counts._replace(untimed=self._counts.untimed + frames)

    def examine(self, source: SerialSource, clock_map: ClockMap) -> Health:
        """Judge the time since the last call, usually a second."""
        counts, now_s = source.received, time.monotonic()
        now = self._counts._replace(damaged=counts.damaged)
        new = _Counts(*(later - then for later, then in zip(now, self._then, strict=True)))
        rate = new.frames / (now_s - self._examined_s)
        silence = counts.silence(self._received)
        self._then, self._received, self._examined_s = now, counts, now_s
        abnormal = 1 - new.normal / new.zones if new.zones else 0.0
        values = {
            'port': source.port,
            'frame rate [Hz]': f'{rate:.1f}',
            'frames': str(now.frames),
            'lost frames': str(now.lost),
            'abnormal zones [%]': f'{100 * abnormal:.1f}',
            'latency [ms]': f'{1e-6 * new.late_ns / max(new.frames, 1):.1f}',
            'packets with CRC errors': str(counts.bad_crc),
            'packets with framing errors': str(counts.bad_framing + counts.overlong),
            'packets of a wrong shape': str(counts.bad_shape),
            'packets of an unknown kind': str(counts.unknown_kind),
            'openings of the port': str(source.openings),
            'clock offset [s]': f'{clock_map.offset_s:.6f}',
            'clock skew [ppm]': f'{clock_map.skew * 1e6:.0f}',
            'clock restarts': str(clock_map.restarts),
        }
        problems = []
        if not source.is_open:
            problems.append((ERROR, source.problem))
        elif not new.frames:
            problems.append((ERROR, NO_CLOCK if new.untimed else silence))
        elif stamps_stand(new.frames, new.stamp_ns):
            problems.append((ERROR, 'the stamps stand still: has /clock stopped?'))
        elif new.damaged or new.lost:
            problems.append((WARN, f'{new.damaged} damaged packets, {new.lost} lost frames'))
        elif abnormal > _MANY_ABNORMAL:
            problems.append((WARN, f'{100 * abnormal:.0f} % of the zones are abnormal'))
        return Health(problems, values, f'{rate:.1f} frames a second')


class DetectorWatch:
    """Watches the heartbeat of the detector, which cannot report that it was killed, or hangs."""

    def __init__(self, node: Node) -> None:
        self._beat_s: float | None = None
        self._frame_s = 0.0
        node.create_subscription(Header, 'detector/heartbeat', self._beat, 10)

    def _beat(self, _: Header) -> None:
        self._beat_s = self._frame_s = time.monotonic()

    def sent(self) -> None:
        """Note that a frame was sent."""
        self._frame_s = time.monotonic()

    def problem(self) -> str:
        """Return that a detector sent heartbeats before, and is silent although frames are sent."""
        if self._beat_s is None or (silence_s := self._frame_s - self._beat_s) < _SILENCE_S:
            return ''
        return f'the detector has judged no frame for {silence_s:.1f} s: it has ended, or hangs'
