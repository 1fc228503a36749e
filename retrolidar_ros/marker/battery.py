# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Current of a marker and life of its battery (paper §5, Tab. 2).

A marker sleeps, looks for the sensor's light in short regular windows, and is active while it
sends packets. Self-discharge, and the capacity left below the least voltage, are not modelled.
"""

from dataclasses import dataclass

from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.marker.wakeup import LOOK_EVERY_S, LOOK_S

CELL_MAH = 90.0  # the paper's
_HOUR_S = 3600.0


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


def active_share(queries_per_hour: float, packets: int = 1) -> float:
    """Return the share of time in which a marker sends; ValueError for impossible queries."""
    share = queries_per_hour * packets * PACKET_S / _HOUR_S
    if not 0 <= share <= 1:
        max_queries = _HOUR_S / (packets * PACKET_S)
        raise ValueError(
            f'{queries_per_hour:g} queries an hour are impossible; 0 to {max_queries:.0f}, '
            f'as each takes {packets * PACKET_S:g} s'
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
