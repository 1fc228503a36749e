# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of heartbeat and two sensors, however their nodes were started."""

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from harness import check_detections
from harness_observer import RELIABLE, Observer, values_of
from std_msgs.msg import Bool

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.scene.description import Scene
from retrolidar_ros.scene.files import find_scene
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_yaml

SIDES = ('left', 'right')
OVERDUE_AFTER_S = 2.0
# The nodes look at the time ten times a second; the rest is for a machine that is busy.
_LATENESS_S = 3.0


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
    # A marker that has just appeared may be read before its packet has come, and then the whole.
    assert len(messages) <= int(values['drone: readings']) <= marker.packets + 1
    silence_s = float(values['drone: silence [s]'])
    assert silence_s >= OVERDUE_AFTER_S  # rounded
    assert float(values['drone: longest silence [s]']) >= silence_s


def check_two_sensors(observer: Observer, scene: Scene) -> None:
    """What both sensors see comes on one topic, and each marker has one TF frame below each."""
    frames = {side: observer.collect(FrameMsg, f'{side}/frames', RELIABLE) for side in SIDES}
    optical = {side: f'{side}_optical_frame' for side in SIDES}
    names = {f'{side}_{marker.name}' for side in SIDES for marker in scene.markers}
    observer.wait(lambda: all(frames.values()), 'both sensors')
    # They may be of frames from before these subscriptions.
    observer.markers.clear()
    observer.wait(lambda: {one.child_frame_id for one, _ in observer.markers} >= names, 'readings')
    read = [message for message, _ in observer.markers]
    assert {one.child_frame_id for one in read} == names

    def stamps(messages: Iterable[Any]) -> set[int]:
        return {to_ns(one.header.stamp) for one in messages}

    def all_came() -> bool:
        ends = {to_ns(one.end) for one in read}
        of_frames = stamps(frames['left']) | stamps(frames['right'])
        return ends <= of_frames and stamps(read) <= stamps(observer.transforms)

    observer.wait(all_came, 'frames and transforms of all readings')
    for side in SIDES:
        own = [one for one in read if one.child_frame_id.startswith(f'{side}_')]
        name = f'{side}_{{0.name}}'
        check_detections(observer, scene, optical[side], own, frames[side], name)
        assert {one.header.frame_id for one in frames[side]} == {optical[side]}
    assert stamps(frames['left']) & stamps(frames['right']) == set()
    parents = {
        (one.child_frame_id, one.header.frame_id)
        for one in observer.transforms
        if one.header.frame_id in optical.values()
    }
    assert parents == {(name, optical[name.partition('_')[0]]) for name in names}
