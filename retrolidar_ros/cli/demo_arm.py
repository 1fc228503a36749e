# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An arm that looks from several places: sensor, driver, detector and landmarks, and the truth."""

import math
import time
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from retrolidar_ros.cli.demo import COMMON, executable, running_nodes, start_emulator
from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.nodes.conversion import covariance_of, to_ns, vector_of
from retrolidar_ros.nodes.emulated_arm import IN_BASE
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.qos import LATCHED
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.truth import is_inside
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.files import shared_file

_BEFORE_S = 3.0  # from the start of the emulator to the time zero of the scene
_LATE_S = 1.0  # the estimate of a place is complete so long after the hand has left it


class Known(NamedTuple):
    """The estimate of an object at a time in the scene."""

    time_s: float
    off_mm: float  # size of its error
    stddev_mm: float  # its estimated deviation along the worst axis
    is_inside: bool  # whether the truth is in its 99.9 % ellipsoid

    def __str__(self) -> str:
        """Return error and deviation [mm]."""
        return f'{self.off_mm:.1f} ± {self.stddev_mm:5.1f}'


class _Hand:
    """Collects the poses of objects, in the frame of the scene."""

    def __init__(self, listener: Listener, scene: Scene) -> None:
        self.zero_ns = 0  # when the scene begins; 0 = it does not yet
        self.stays = [
            (np.array(after.position_m), after.time_s)
            for before, after in pairwise(scene.sensor.path)
            if before.position_m == after.position_m
        ]
        """Where the hand stays for a while [m], and until when [s]."""
        self._known: dict[str, list[Known]] = {marker.name: [] for marker in scene.markers}
        for marker in scene.markers:
            topic = f'landmarks/objects/{marker.name}'
            take = partial(self._take, marker.name, np.array(marker.position_m))
            listener.node.create_subscription(PoseWithCovarianceStamped, topic, take, LATCHED)

    def after(self, stay: int, name: str) -> Known | None:
        """Return the estimate of an object when the hand left a place."""
        known = [one for one in self._known[name] if one.time_s < self.stays[stay][1]]
        return known[-1] if known else None

    def time_s(self, stamp_ns: int) -> float:
        """Return a time in the scene [s]."""
        return (stamp_ns - self.zero_ns) * 1e-9

    def _take(self, name: str, truth_m: Floats, message: PoseWithCovarianceStamped) -> None:
        off_m = IN_BASE.T @ vector_of(message.pose.pose.position) - truth_m
        covariance = IN_BASE.T @ covariance_of(message.pose)[:3, :3] @ IN_BASE
        time_s = self.time_s(to_ns(message.header.stamp))
        off_mm = 1e3 * float(np.linalg.norm(off_m))
        stddev_mm = 1e3 * largest_stddev(covariance)
        self._known[name].append(Known(time_s, off_mm, stddev_mm, is_inside(off_m, covariance)))


def run_arm(scene: Scene, file: Path, picture: Path, listener: Listener) -> int:
    """Run a scene whose sensor moves; return 0 if all ellipsoids hold in the end, else 1."""
    print(f'{scene.description}\nDriver, detector and landmarks are starting ...', flush=True)
    names = [marker.name for marker in scene.markers]
    hand = _Hand(listener, scene)
    markers = f'marker_file:={shared_file("config/markers.yaml")}'
    apart = ['-r', '/tf:=tf']  # a topic apart from that of a robot
    options = ['-p', markers, *apart]
    with running_nodes(listener, options) as (processes, port):
        start_ns = time.monotonic_ns() + round(_BEFORE_S * 1e9)
        hand.zero_ns = start_ns + time.time_ns() - time.monotonic_ns()
        start = f'{start_ns * 1e-9:.9f}'
        arm = ['-p', f'scene:={file}', '-p', f'start:={start}', *apart]
        processes.start('emulated_arm', [executable('emulated_arm'), *COMMON, *arm])
        start_emulator(processes, str(file), port, '--start', start)
        print(' ' * 26 + ''.join(f'{one:>16}' for one in names), flush=True)
        for index, (place_m, left_s) in enumerate(hand.stays):

            def has_left(until_s: float = left_s + _LATE_S) -> bool:
                processes.check()
                return hand.time_s(time.time_ns()) > until_s

            listener.spin_until(has_left, math.inf)
            cells = ''.join(f'{hand.after(index, one) or "-"!s:>16}' for one in names)
            place = ', '.join(f'{one:5.2f}' for one in place_m)
            print(f'  {index + 1}. ({place}) m {cells}', flush=True)
    print('Error of the position ± its estimated deviation along the worst axis [mm]\n')
    _draw(hand, names, picture)
    last = [hand.after(len(hand.stays) - 1, one) for one in names]
    good = sum(one is not None and one.is_inside for one in last)
    print(f'picture: {picture}\n{good} of {len(last)} objects are in their 99.9 % ellipsoid')
    return 0 if good == len(last) else 1


def _draw(hand: _Hand, names: Sequence[str], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4.5), layout='constrained')
    axes = figure.subplots()
    for name in names:
        found = [(stay + 1, hand.after(stay, name)) for stay in range(len(hand.stays))]
        known = [(place, one.off_mm, one.stddev_mm) for place, one in found if one]
        if known:
            place, off_mm, stddev_mm = zip(*known, strict=True)
            (line,) = axes.plot(place, off_mm, 'o-', label=name)
            axes.plot(place, stddev_mm, ':', color=line.get_color())
    axes.set(yscale='log', xlabel='places', ylabel='position [mm]')
    axes.set_title('Error of the position; dotted: its estimated deviation along the worst axis')
    axes.set_xticks(range(1, len(hand.stays) + 1))
    axes.legend(frameon=False)
    figure.savefig(path, dpi=100)
