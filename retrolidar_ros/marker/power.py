# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Power of a marker: what wakes it (paper §3.3), and how long its battery lasts (§5, Tab. 2).

The sensor's light on its photodiode is held against a threshold. All voltages are root mean squares
behind both filters. Light and noise are independent, so their powers add: V² = noise² + light². The
light falls with the square of the distance (§6.5) and with the cosine of the angle. Saturation of
the amplifier at close range is not modelled.

A marker sleeps, looks for that light in short regular windows, and is active while it sends
packets. Self-discharge, and the capacity left below the least voltage, are not modelled.
"""

import math
from dataclasses import dataclass

import numpy as np

from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.sensor.frame import Floats

# Paper Tab. 5, both filters [V].
NOISE_V = {'dark': 14.812e-3, 'indoors': 16.443e-3, 'LED': 16.895e-3, 'outdoors': 36.695e-3}
"""Noise by surroundings; LED is an infrared camera's."""
GUARD_V = 1e-3
THRESHOLD_V = NOISE_V['indoors'] + GUARD_V  # the paper's (§6.5)
REACH_M = 2.25  # distance up to which the paper's threshold is exceeded (§6.5)
LARGEST_ANGLE_RAD = math.radians(55)  # angle beyond which the photodiode receives nothing (§6.5)
LOOK_S = 1e-3
LOOK_EVERY_S = 0.1
LATENCY_S = 0.4e-3  # of the circuit (paper §5)
WAKING_S = LOOK_EVERY_S + LATENCY_S  # longest time from the first light to the first bit
CELL_MAH = 90.0  # the paper's
_HOUR_S = 3600.0


def needed_light_v(threshold_v: float, noise_v: float) -> float:
    """Return the voltage of light [V] that lifts noise to a threshold; 0 if noise alone does."""
    return math.sqrt(max(0.0, threshold_v**2 - noise_v**2))


LIGHT_AT_1_M_V = REACH_M**2 * needed_light_v(THRESHOLD_V, NOISE_V['indoors'])


def voltage_v(
    range_m: Floats, angle_rad: float = 0.0, noise_v: float = NOISE_V['indoors']
) -> Floats:
    """Return the voltage of light and noise [V], at distances (...) [m] and an angle."""
    return np.hypot(noise_v, LIGHT_AT_1_M_V * _facing(angle_rad) / np.square(range_m))


def wakeup_range_m(
    threshold_v: float = THRESHOLD_V, noise_v: float = NOISE_V['indoors'], angle_rad: float = 0.0
) -> float:
    """Return the distance up to which the marker wakes [m]; infinite if noise alone does it."""
    needed_v = needed_light_v(threshold_v, noise_v)
    if needed_v == 0:
        return math.inf
    return math.sqrt(LIGHT_AT_1_M_V * _facing(angle_rad) / needed_v)


def _facing(angle_rad: float) -> float:
    return math.cos(angle_rad) if abs(angle_rad) <= LARGEST_ANGLE_RAD else 0.0


@dataclass(frozen=True)
class Currents:
    """Current of a marker in each mode [mA], or by each mode in the mean; those of paper Tab. 2."""

    sleep: float = 0.001
    detection: float = 3.98
    active: float = 12.7

    @property
    def total(self) -> float:
        """Their sum [mA]."""
        return self.sleep + self.detection + self.active


PROTOTYPE = Currents()


def active_share(queries_per_hour: float) -> float:
    """Return the share of time in which a marker sends a packet a query.

    ValueError for impossible queries.
    """
    share = queries_per_hour * PACKET_S / _HOUR_S
    if not 0 <= share <= 1:
        raise ValueError(
            f'{queries_per_hour:g} queries an hour are impossible; 0 to {_HOUR_S / PACKET_S:.0f}, '
            f'as each takes {PACKET_S:g} s'
        )
    return share


def drawn(active: float, currents: Currents = PROTOTYPE) -> Currents:
    """Return the mean currents [mA] of a marker that is active for a share of the time."""
    looking = LOOK_S / LOOK_EVERY_S
    return Currents(
        sleep=currents.sleep * (1 - looking) * (1 - active),
        detection=currents.detection * looking * (1 - active),
        active=currents.active * active,
    )
