# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stamps: from the sensor's clock to the host's, with messages going one way only.

A frame reaches the host some varying time after its exposure, never before. So the line from
sensor time to host time is the support of the lower convex hull of all pairs of them (Zhang, Liu
and Xia, Clock synchronization algorithms for network measurements, INFOCOM 2002). What remains is
a constant, the smallest delay that ever occurred.
"""

WINDOW_S = 60.0  # how far back pairs are kept: long against jitter, short against drifts
MAX_SKEW = 0.05  # largest relative error of a sensor's clock that is accepted
# Frames come early only if a clock was set; late also while the transport stalls, but not long.
_STEP_NS = 100_000_000
_STALL_NS = 1_000_000_000
_YOUNG_NS = 1_000_000_000
_TURN_NS = 2**32 * 1000  # of a 32-bit counter of microseconds: 71.6 minutes


class ClockMap:
    """Maps a sensor's time to host time, learning from each frame's arrival.

    A sensor that restarts or a host clock that is set makes the map start again; `restarts` counts
    how often. A 32-bit sensor clock that wraps is followed.
    """

    def __init__(self, min_delay_s: float = 0.0) -> None:
        """Start without knowledge; stamps are less by the known delay `min_delay_s`."""
        self.restarts = 0
        self.skew = 0.0  # host seconds per sensor second, less one; 0 while unknown
        self.offset_s = 0.0  # host time less sensor time, of the last frame
        self._turns_ns = 0
        self.set_min_delay(min_delay_s)
        self._hull: list[tuple[int, int]] = []
        self._rate, self._origin = 1.0, (0, 0)
        self._last_pair = (0, 0)
        self._punctual_ns = 0

    def set_min_delay(self, min_delay_s: float) -> None:
        """Subtract another delay from the stamps to come, which may go back once."""
        self._min_delay_ns = round(min_delay_s * 1e9)
        self._last_stamp_ns: int | None = None

    def map(self, sensor_time_us: int, arrival_ns: int) -> int:
        """Return the host time [ns] of the middle of an exposure, by the clocks of sensor and host.

        The frame has arrived at `arrival_ns`. Stamps never go back unless arrivals do.
        """
        sensor_ns = self._unwrapped(sensor_time_us * 1000, arrival_ns)
        if self._hull and self._is_restart(sensor_ns, arrival_ns):
            self._hull.clear()
            if arrival_ns < self._last_pair[1]:
                self._last_stamp_ns = None
            self.restarts += 1
        if not self._hull:
            self._punctual_ns = sensor_ns
        self._last_pair = (sensor_ns, arrival_ns)
        self._add(sensor_ns, arrival_ns)
        self._rate, self._origin = self._line()
        self.skew = self._rate - 1.0
        stamp_ns = min(self._on_line(sensor_ns), arrival_ns) - self._min_delay_ns
        if self._last_stamp_ns is not None:
            stamp_ns = max(stamp_ns, self._last_stamp_ns + 1)
        self._last_stamp_ns = stamp_ns
        self.offset_s = (stamp_ns - sensor_time_us * 1000) * 1e-9
        return stamp_ns

    def _unwrapped(self, sensor_ns: int, arrival_ns: int) -> int:
        """Return a sensor time without the wraps of a 32-bit clock."""
        if self._hull and sensor_ns + self._turns_ns < self._last_pair[0]:
            step_ns = sensor_ns + self._turns_ns + _TURN_NS - self._last_pair[0]
            has_wrapped = abs(step_ns - (arrival_ns - self._last_pair[1])) < _STALL_NS
            self._turns_ns = self._turns_ns + _TURN_NS if has_wrapped else 0
        return sensor_ns + self._turns_ns

    def _on_line(self, sensor_ns: int) -> int:
        origin_sensor_ns, origin_host_ns = self._origin
        # Differences are taken in integers: ROS time in nanoseconds exceeds a float's precision.
        return origin_host_ns + round(self._rate * (sensor_ns - origin_sensor_ns))

    def _is_restart(self, sensor_ns: int, arrival_ns: int) -> bool:
        """Return whether a clock was set: it went back, or a frame is early, or all are late.

        A step of less than 0.1 s is not noticed, and vanishes as the window moves on.
        """
        sensor_step = sensor_ns - self._last_pair[0]
        late_ns = arrival_ns - self._on_line(sensor_ns)
        tolerance = _STEP_NS + MAX_SKEW * sensor_step
        if sensor_step <= 0 or arrival_ns < self._last_pair[1] or late_ns < -tolerance:
            return True
        if late_ns <= tolerance:
            self._punctual_ns = sensor_ns
        return late_ns > tolerance + _STALL_NS or sensor_ns - self._punctual_ns > _STALL_NS

    def _add(self, sensor_ns: int, arrival_ns: int) -> None:
        """Add a pair at the right end of the lower convex hull and drop old ones."""
        hull = self._hull
        while len(hull) > 1:
            (x0, y0), (x1, y1) = hull[-2], hull[-1]
            if (y1 - y0) * (sensor_ns - x0) < (arrival_ns - y0) * (x1 - x0):
                break
            hull.pop()
        hull.append((sensor_ns, arrival_ns))
        oldest_ns = sensor_ns - round(WINDOW_S * 1e9)
        while len(hull) > 2 and hull[1][0] <= oldest_ns:
            del hull[0]
        # The first edge itself may be hours long, for on steady clocks all pairs lie on one line.
        # An edge to the newest pair is left whole: the pair may be late, and the next replace it.
        if len(hull) > 2 and hull[0][0] < oldest_ns:
            (x0, y0), (x1, y1) = hull[0], hull[1]
            hull[0] = (oldest_ns, y0 + (y1 - y0) * (oldest_ns - x0) // (x1 - x0))

    def _line(self) -> tuple[float, tuple[int, int]]:
        """Return rate and one point of the supporting line: the hull's edge over its middle.

        Of all lines below the pairs this one is nearest to them on average. Until the hull is
        a second long, the rate is taken to be 1 and only the offset is learned.
        """
        hull = self._hull
        (first_ns, _), (last_ns, _) = hull[0], hull[-1]
        if last_ns - first_ns < _YOUNG_NS:
            return 1.0, min(hull, key=lambda pair: pair[1] - pair[0])
        middle_ns = (first_ns + last_ns) // 2
        right = next(index for index, pair in enumerate(hull) if pair[0] > middle_ns)
        (x0, y0), (x1, y1) = hull[right - 1], hull[right]
        rate = (y1 - y0) / (x1 - x0)
        return min(max(rate, 1 / (1 + MAX_SKEW)), 1 / (1 - MAX_SKEW)), (x0, y0)
