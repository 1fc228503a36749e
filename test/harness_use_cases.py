# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of heartbeat and two sensors, however their nodes were started."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from harness_observer import RELIABLE, Observer, values_of
from std_msgs.msg import Bool

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import covariance_of, to_ns, vector_of
from retrolidar_ros.scene.description import Scene
from retrolidar_ros.scene.files import find_scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_yaml

SIDES = ('left', 'right')
OVERDUE_AFTER_S = 2.0
# A position is further off in one of a thousand cases, were its error normal.
MOST_MAHALANOBIS = 16.27
# The nodes look at the time ten times a second; the rest is for a machine that is busy.
_LATENESS_S = 1.0


def check_place(position_m: Floats, covariance: Floats, truth_m: Floats, eye_m: Floats) -> None:
    """A place is as far from the eye of the sensor as the truth is, and as sure as it says."""
    error = position_m - truth_m
    range_m = float(np.linalg.norm(truth_m - eye_m))
    assert abs(np.linalg.norm(position_m - eye_m) - range_m) < 0.01
    assert np.linalg.norm(error) < 0.16 * range_m  # within its zone
    assert np.allclose(covariance, covariance.T)
    variances = np.linalg.eigvalsh(covariance)
    assert variances.min() > 0
    assert np.sqrt(variances.max()) < 0.12 * range_m
    assert error @ np.linalg.solve(covariance, error) < MOST_MAHALANOBIS


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


def impatient_parameters(directory: Path) -> Path:
    """Write a copy of the shipped parameters with a short `overdue_after`; return its path."""
    parameters = load_yaml(shared_file('config/retrolidar.yaml'))
    parameters['/**/heartbeat']['ros__parameters']['overdue_after'] = OVERDUE_AFTER_S
    path = directory / 'impatient.yaml'
    path.write_text(yaml.safe_dump(parameters))
    return path


def check_heartbeat(observer: Observer, scene: Scene) -> None:
    """A drone is alive from its first reading on, and overdue some time after its last."""
    (marker,) = scene.markers
    assert marker.packets is not None
    name = 'heartbeat: markers'
    alive = observer.collect(Bool, 'heartbeat/alive')
    observer.wait(lambda: bool(observer.markers), 'a reading')
    observer.wait(lambda: bool(alive) and alive[-1].data, 'life')
    alive.clear()
    values = values_of(observer.wait_for_status(name, DiagnosticStatus.OK, 'all markers are read'))
    assert int(values['drone: readings']) >= 1
    assert float(values['drone: silence [s]']) <= OVERDUE_AFTER_S
    observer.wait(lambda: bool(alive), 'silence to be noticed')
    noticed_s = time.time()
    assert [one.data for one in alive] == [False]  # and it was alive between its readings
    messages = [message for message, _ in observer.markers]
    assert {(one.id, one.child_frame_id) for one in messages} == {(marker.id, 'drone')}
    last_s = observer.markers[-1][1] * 1e-9
    assert abs(noticed_s - last_s - OVERDUE_AFTER_S) < _LATENESS_S
    values = values_of(observer.wait_for_status(name, DiagnosticStatus.WARN, 'overdue: drone'))
    assert len(messages) <= int(values['drone: readings']) <= marker.packets
    silence_s = float(values['drone: silence [s]'])
    assert silence_s > OVERDUE_AFTER_S
    assert float(values['drone: longest silence [s]']) >= silence_s


def _side(message: Any) -> str:
    return str(message.child_frame_id).partition('_')[0]


def check_two_sensors(observer: Observer, scene: Scene) -> None:
    """What both sensors see comes on one topic, and each marker has one TF frame below each."""
    frames = {side: observer.collect(FrameMsg, f'{side}/frames', RELIABLE) for side in SIDES}
    markers = {f'{side}_{one.name}': one for side in SIDES for one in scene.markers}
    observer.wait(lambda: all(frames.values()), 'both sensors')
    observer.markers.clear()  # they may be of frames that came before these were heard

    def missing() -> set[str]:
        transforms = {(one.child_frame_id, to_ns(one.header.stamp)) for one in observer.transforms}
        messages = [message for message, _ in observer.markers]
        placed = {(one.child_frame_id, to_ns(one.header.stamp)) for one in messages} & transforms
        return set(markers) - {name for name, _ in placed}

    observer.wait(lambda: not missing(), 'a detection and a transform of each')
    messages = [message for message, _ in observer.markers]

    def stamps(side: str) -> set[int]:
        return {to_ns(one.header.stamp) for one in frames[side]}

    def unheard() -> set[int]:
        """Return the ends of readings whose last frame is still on its way to here."""
        ends = {side: {to_ns(one.end) for one in messages if _side(one) == side} for side in SIDES}
        return {end for side in SIDES for end in ends[side] - stamps(side)}

    observer.wait(lambda: not unheard(), 'the frames of all readings')
    for side, collected in frames.items():
        assert {one.header.frame_id for one in collected} == {f'{side}_optical_frame'}
    assert stamps('left') & stamps('right') == set()
    for message in messages:
        side, _, name = message.child_frame_id.partition('_')
        marker = markers[message.child_frame_id]
        assert (message.id, name) == (marker.id, marker.name)
        assert message.header.frame_id == f'{side}_optical_frame'
        position = vector_of(message.pose.pose.position)
        truth = np.array(marker.position_m)
        check_place(position, covariance_of(message.pose)[:3, :3], truth, np.zeros(3))
    parents = {
        (one.child_frame_id, one.header.frame_id)
        for one in observer.transforms
        if one.header.frame_id in {f'{side}_optical_frame' for side in SIDES}
    }
    assert parents == {(name, f'{name.partition("_")[0]}_optical_frame') for name in markers}
