# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor that a test plugs, pulls and disturbs, and what is asserted of driver and detector.

The assertions are the same whether a launch file or a plain process runner started the nodes.
"""

import threading
import time
from dataclasses import replace
from itertools import chain, dropwhile
from pathlib import Path

import numpy as np
import yaml
from geometry_msgs.msg import TransformStamped

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import covariance_of, to_ns, vector_of
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.description import Marker, Scene, find_scene
from retrolidar_ros.scene.emulator import PortLink, frames_in_real_time
from retrolidar_ros.sensor.frame import Floats, Frame
from retrolidar_ros.sensor.wire import encode_frame
from retrolidar_ros.settings.files import load_yaml

STAMP_ERROR_S = 0.050
PATIENCE_S = 60.0
# A position is further off in one of a thousand cases, were its error normal.
MAX_MAHALANOBIS = 16.27


class Sensor:
    """Emulates a scene in a thread, and knows when each frame was really exposed."""

    def __init__(self, scene: Scene, port: Path) -> None:
        self.middle_ns: dict[int, int] = {}
        """True middle of the exposure of each frame that was sent undamaged, by sequence."""
        self.damaged: set[int] = set()
        self.corrupt_share = 0.0
        """Share of packets of which the last byte before the delimiter is another one."""
        self.lost_share = 0.0
        """Share of frames that the sensor does not send."""
        self._first: Frame | None = None
        """Whose sequence and time are zero since the sensor last started."""
        self._scene = scene
        self.path = port
        self._port: PortLink | None = None
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._rng = np.random.default_rng(1)
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> 'Sensor':
        self.plug()
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self.pull()

    def plug(self) -> None:
        with self._lock:
            self._port = PortLink(self.path)

    def pull(self) -> None:
        with self._lock:
            if self._port is not None:
                self._port.close()
            self._port = None

    def restart(self) -> None:
        """Begin sequence and clock at zero with the next frame."""
        with self._lock:
            self._first = None

    def _since_start(self, frame: Frame) -> Frame:
        with self._lock:
            if self._first is None:
                self._first = frame
                self.middle_ns.clear()
            first = self._first
        time_us = frame.sensor_time_us - first.sensor_time_us
        return replace(frame, sequence=frame.sequence - first.sequence, sensor_time_us=time_us)

    def _run(self) -> None:
        frames = frames_in_real_time(self._scene, None, time.time_ns(), time.time_ns)
        for simulated, middle_ns in frames:
            if self._stop.is_set():
                return
            if self._rng.random() < self.lost_share:
                continue
            frame = self._since_start(simulated)
            data = bytearray(encode_frame(frame))
            # Recorded before it is sent: who receives it may look it up at once.
            if self._rng.random() < self.corrupt_share:
                data[-2] = data[-2] % 255 + 1  # which is of the checksum, or of the framing
                self.damaged.add(frame.sequence)
            else:
                self.middle_ns[frame.sequence] = middle_ns
            with self._lock:
                is_sent = self._port is not None and self._port.write(bytes(data))
            if not is_sent:
                self.damaged.discard(frame.sequence)
                self.middle_ns.pop(frame.sequence, None)


def silent_drone(directory: Path, start_s: float, packets: int) -> Path:
    """Write the scene of a drone that falls silent; return its path."""
    scene = load_yaml(find_scene('drone'))
    (marker,) = scene['markers']
    # It hangs still: where it goes from zone to zone, a packet may be missed.
    del marker['wander'], marker['occlusion']
    marker |= {'start': f'{start_s} s', 'packets': packets}
    path = directory / 'silent_drone.yaml'
    path.write_text(yaml.safe_dump(scene))
    return path


def wait_for_nodes(listener: Listener) -> None:
    assert listener.spin_until(listener.is_connected, PATIENCE_S), 'driver or detector is missing'


def wait_for_traffic(listener: Listener) -> None:
    """Wait for all topics of nodes that run already, and forget what was read until then."""
    assert listener.spin_until(
        lambda: bool(listener.frames and listener.markers and listener.transforms), PATIENCE_S
    ), 'a topic is silent'
    listener.markers.clear()


def wait_for_readings(listener: Listener, ids: set[int]) -> None:
    def all_read() -> bool:
        return ids <= {one.id for one in listener.readings()} - listener.untransformed()

    assert listener.spin_until(all_read, PATIENCE_S), f'read only {listener.readings()}'


def check_frames(listener: Listener, sensor: Sensor, frame_id: str) -> None:
    """Frames are whole, in order, and stamped with the time of their exposure."""
    # The topic of frames may have been found long after the one of detections.
    assert listener.spin_until(lambda: len(listener.frames) > 20, PATIENCE_S), 'no frames'
    stamps = [to_ns(message.header.stamp) for message, _ in listener.frames]
    assert stamps == sorted(set(stamps))
    check_stamps(listener, sensor)
    for message, received_ns in listener.frames:
        assert message.header.frame_id == frame_id
        assert (message.rows, message.columns) == (4, 4)
        for values in (message.distance, message.signal, message.ambient, message.status):
            assert len(values) == 16
        assert to_ns(message.header.stamp) < received_ns


def check_stamps(listener: Listener, sensor: Sensor, some: slice = slice(None)) -> None:
    """Frames that have come are stamped with the time of their exposure.

    No clock can know that all frames since its start came late: by how much the least late one did.
    """
    late_s = np.inf
    for message, received_ns in listener.frames[some]:
        middle_ns = sensor.middle_ns[message.sequence]
        late_s = min(late_s, (received_ns - middle_ns) * 1e-9)
        error_s = (to_ns(message.header.stamp) - middle_ns) * 1e-9
        named = f'frame {message.sequence}: {error_s * 1e3:.1f} ms'
        assert -STAMP_ERROR_S < error_s < max(STAMP_ERROR_S, late_s), named


def check_detections(
    listener: Listener,
    scene: Scene,
    frame_id: str,
    frames: list[FrameMsg] | None = None,
    name: str = 'marker_{0.id}',
) -> None:
    """Detections of the scene's markers are placed, timed and named as they should be.

    The frames are all that were heard, or those that are given.
    """

    def frame_stamps() -> list[int]:
        came = [message for message, _ in listener.frames] if frames is None else frames
        return [to_ns(message.header.stamp) for message in came]

    def key(one: TransformStamped | MarkerDetection) -> tuple[str, int]:
        return one.child_frame_id, to_ns(one.header.stamp)

    def transforms() -> dict[tuple[str, int], TransformStamped]:
        return {key(one): one for one in listener.transforms}

    def read(marker: Marker) -> list[MarkerDetection]:
        # Any topic may have been found before the others.
        sent, first_ns = transforms(), min(frame_stamps())
        own = [one for one, _ in listener.markers if one.header.frame_id == frame_id]
        own = [one for one in own if one.id == marker.id and to_ns(one.end) >= first_ns]
        return [*dropwhile(lambda one: key(one) not in sent, own)]

    assert listener.spin_until(
        lambda: bool(frame_stamps()) and all(map(read, scene.markers)), PATIENCE_S
    ), 'not all are read'
    detections = {marker.id: read(marker) for marker in scene.markers}
    everything = [*chain.from_iterable(detections.values())]
    ends, keys = {to_ns(message.end) for message in everything}, {*map(key, everything)}
    assert listener.spin_until(lambda: ends <= {*frame_stamps()}, PATIENCE_S), 'frames are missing'
    assert listener.spin_until(lambda: keys <= {*transforms()}, PATIENCE_S), (
        'transforms are missing'
    )
    if frames is None:
        assert {one.header.frame_id for one, _ in listener.markers} == {frame_id}
    for marker in scene.markers:
        for message in detections[marker.id]:
            assert message.child_frame_id == name.format(marker)
            stamp_ns = to_ns(message.header.stamp)
            start_ns, end_ns = to_ns(message.start), to_ns(message.end)
            assert start_ns - 10**8 < stamp_ns < end_ns
            # From any bit of a repeating marker on, so the first packet may have begun half a
            # packet earlier or later; what has just appeared needs fewer bits.
            packets = (end_ns - start_ns) * 1e-9 / 1.302
            assert message.packets - 0.7 < packets < message.packets + 0.54
            assert abs(message.range - np.linalg.norm(marker.position_m)) < 0.01
            place_m = vector_of(message.pose.pose.position)
            truth_m = np.array(marker.position_m)
            check_place(place_m, covariance_of(message.pose)[:3, :3], truth_m, np.zeros(3))
            transform = transforms()[key(message)]
            assert transform.header.frame_id == frame_id
            assert (vector_of(transform.transform.translation) == place_m).all()
            assert transform.transform.rotation == message.pose.pose.orientation


def check_place(position_m: Floats, covariance: Floats, truth_m: Floats, eye_m: Floats) -> None:
    """A position has the right range, and an error within its covariance."""
    error = position_m - truth_m
    range_m = float(np.linalg.norm(truth_m - eye_m))
    assert abs(np.linalg.norm(position_m - eye_m) - range_m) < 0.01
    # Anywhere in the zone: half its diagonal at most.
    assert np.linalg.norm(error) < 0.16 * range_m
    assert np.allclose(covariance, covariance.T)
    variances = np.linalg.eigvalsh(covariance)
    assert variances.min() > 0
    assert np.sqrt(variances.max()) < 0.12 * range_m
    assert error @ np.linalg.solve(covariance, error) < MAX_MAHALANOBIS
