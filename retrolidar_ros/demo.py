# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole chain on one machine: emulated sensor, driver and detector, against the truth."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.frame import Floats, Recording
from retrolidar_ros.plot import Reading, plot_readings
from retrolidar_ros.processes import ProcessError, ProcessGroup
from retrolidar_ros.resources import shared_file
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.yaml_files import find_scene, load_scene

if TYPE_CHECKING:
    from retrolidar_ros.nodes.listener import Listener

NAMESPACE = '/retrolidar'
READINGS = 3
"""How often each marker is to be read before the demo ends."""
MAX_RANGE_ERROR_M = 0.01
_PACKET_NS = PACKET_BITS * BIT_PERIOD_S * 1e9
# Moments of a reading at which the true range is asked.
_PARTS = (np.arange(32) + 0.5) / 32
_TAKEN = (
    f'another driver publishes {NAMESPACE}/frames; end it, or set ROS_DOMAIN_ID to a free number'
)


class Heard(NamedTuple):
    """One `MarkerDetection`, as far as the demo judges it."""

    id: int
    start_ns: int
    stamp_ns: int
    packets: int
    range_m: float
    snr_db: float
    position_m: tuple[float, float, float]
    zone: int
    has_transform: bool


class Outcome(NamedTuple):
    """What became of one ID: a marker of the scene, or a ghost that no marker sent."""

    id: int
    name: str
    readings: int
    range_m: float
    """True range, mean over the readings; NaN for a ghost."""
    error_m: float
    """Measured less true range, of the reading in which it is largest; NaN without truth."""
    snr_db: float
    first_reading_s: float
    """From the first frame to the end of the first reading; NaN without any."""
    has_transforms: bool

    @property
    def good(self) -> bool:
        """Whether a marker was read, placed by TF, and ranged well."""
        return self.readings > 0 and self.has_transforms and abs(self.error_m) < MAX_RANGE_ERROR_M


def true_range(scene: Scene, marker: Marker, recording: Recording, stamps: Floats) -> Floats:
    """Return a marker's true range [m] at stamps [ns after the recording's first], any shape."""
    elapsed = (recording.stamp_ns - recording.stamp_ns[0]).astype(np.float64)
    sensor_s = np.interp(stamps, elapsed, recording.sensor_time_us * 1e-6)
    positions = position_at(marker, sensor_s.ravel() / (1 + scene.sensor.clock_error))
    ranges = np.linalg.norm(positions, axis=-1)
    return np.broadcast_to(ranges, stamps.size).reshape(stamps.shape)


def judge(scene: Scene, recording: Recording, heard: Sequence[Heard]) -> list[Outcome]:
    """Set what was heard beside the truth: markers of the scene first, then ghosts."""
    origin_ns = int(recording.stamp_ns[0])
    markers: dict[int, Marker | None] = {marker.id: marker for marker in scene.markers}
    for ghost in sorted({reading.id for reading in heard} - set(markers)):
        markers[ghost] = None
    outcomes = []
    for identity, marker in markers.items():
        own = [reading for reading in heard if reading.id == identity]
        truth: Floats = np.full(len(own), np.nan)
        if marker is not None:
            # A range is the mean over the packets read; the first may have begun before these.
            ends = np.array([reading.stamp_ns - origin_ns for reading in own], dtype=float)
            lengths = _PACKET_NS * np.array([reading.packets for reading in own])
            stamps = ends[:, None] - lengths[:, None] * _PARTS
            truth = true_range(scene, marker, recording, stamps).mean(axis=-1)
        ranges: NDArray[np.float64] = np.array([reading.range_m for reading in own])
        outcomes.append(
            Outcome(
                id=identity,
                name='ghost' if marker is None else marker.name,
                readings=len(own),
                range_m=float(truth.mean()) if own else np.nan,
                error_m=max((ranges - truth).tolist(), key=abs) if own else np.nan,
                snr_db=float(np.median([r.snr_db for r in own])) if own else np.nan,
                first_reading_s=(own[0].stamp_ns - origin_ns) * 1e-9 if own else np.nan,
                has_transforms=all(reading.has_transform for reading in own),
            )
        )
    return outcomes


def table(outcomes: Sequence[Outcome]) -> str:
    """Return outcomes as lines of text."""
    lines = ['     id  name        range [m]  worst [mm]  SNR [dB]  first read [s]  readings  TF']
    lines += [
        f'   {one.id:4d}  {one.name:10}  {one.range_m:9.3f}  {one.error_m * 1e3:10.1f}  '
        f'{one.snr_db:8.1f}  {one.first_reading_s:14.2f}  {one.readings:8d}  '
        f'{"yes" if one.readings and one.has_transforms else "no"}'
        for one in outcomes
    ]
    return '\n'.join(lines)


def executable(node: str) -> str:
    """Return the installed executable of a node, which `ros2 run` would start."""
    from ament_index_python.packages import get_package_prefix

    return str(Path(get_package_prefix('retrolidar_ros')) / 'lib' / 'retrolidar_ros' / node)


def start_nodes(processes: ProcessGroup, port: Path) -> None:
    """Start driver and detector with the shipped parameter file."""
    common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
    common += ['-r', f'__ns:={NAMESPACE}']
    processes.start('driver', [executable('driver'), *common, '-p', f'serial_port:={port}'])
    processes.start('detector', [executable('detector'), *common])


def start_emulator(processes: ProcessGroup, scene: str, port: Path) -> None:
    """Plug in a sensor that sees a scene."""
    emulate = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate']
    processes.start('emulator', [*emulate, scene, '--port-link', str(port)])


def _listen(scene: Scene, listener: Listener, processes: ProcessGroup, timeout_s: float) -> None:
    """Handle messages until every marker was read often enough, and say so as it comes."""
    names = {marker.id: marker.name for marker in scene.markers}
    told: set[int] = set()

    def done() -> bool:
        processes.check()
        readings = [message.id for message, _ in listener.markers]
        for identity in names.keys() & set(readings) - told:
            told.add(identity)
            print(f'  {names[identity]} was read', flush=True)
        enough = all(readings.count(identity) >= READINGS for identity in names)
        return enough and all(heard.has_transform for heard in listener.heard())

    listener.spin_until(done, timeout_s)


def _is_ready(listener: Listener, processes: ProcessGroup) -> bool:
    """Tell whether driver, detector and listener have found each other."""
    processes.check()
    return listener.is_connected()


def run_demo(scene_name: str, picture: Path | None, timeout_s: float) -> int:
    """Run the demo of a scene; return 0 if all its markers were read well, else 1."""
    scene = load_scene(scene_name)
    if not scene.markers:
        raise ValueError(f'{scene_name} has no markers; there is nothing to read')
    try:
        from retrolidar_ros.nodes.listener import Listener
    except ImportError as error:
        raise ValueError(f'the demo needs ROS 2 and this package built for it: {error}') from error
    picture = picture or Path(f'demo_{find_scene(scene_name).stem}.png')
    print(f'{scene.description}\nDriver and detector are starting ...', flush=True)
    with TemporaryDirectory(prefix='retrolidar_') as directory:
        listener = Listener(NAMESPACE)
        try:
            with ProcessGroup(Path(directory)) as processes:
                port = Path(directory) / 'port'
                if listener.spin_until(lambda: listener.node.count_publishers('frames') > 0, 1.0):
                    print(f'retrolidar: {_TAKEN}', file=sys.stderr)
                    return 1
                start_nodes(processes, port)
                if not listener.spin_until(lambda: _is_ready(listener, processes), timeout_s):
                    print(f'retrolidar: no nodes within {timeout_s:g} s', file=sys.stderr)
                    return 1
                print('  driver and detector wait for the sensor', flush=True)
                start_emulator(processes, str(find_scene(scene_name)), port)
                _listen(scene, listener, processes, timeout_s)
        except ProcessError as error:
            print(f'retrolidar: {error}', file=sys.stderr)
            return 1
        finally:
            listener.close()
    recording, heard = listener.recording(), listener.heard()
    if recording is None:
        print(f'retrolidar: no frame came within {timeout_s:g} s', file=sys.stderr)
        return 1
    outcomes = judge(scene, recording, heard)
    print(f'\n{table(outcomes)}\n')
    names = {marker.id: marker.name for marker in scene.markers}
    origin_ns = int(recording.stamp_ns[0])
    plot_readings(
        recording,
        [
            Reading(
                id=one.id,
                name=names.get(one.id, 'ghost'),
                start_s=(one.start_ns - origin_ns) * 1e-9,
                position_m=one.position_m,
                zone=one.zone,
            )
            for one in heard
        ],
        picture,
        origin_ns=origin_ns,
        title=scene.description,
        truth_m={marker.name: marker.position_m for marker in scene.markers},
    )
    print(f'picture: {picture}')
    good = [outcome for outcome in outcomes if outcome.good]
    print(
        f'{len(good)} of {len(scene.markers)} markers read with a range error below '
        f'{MAX_RANGE_ERROR_M * 1e3:.0f} mm'
    )
    return 0 if len(good) == len(scene.markers) else 1
