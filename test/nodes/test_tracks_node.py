# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks over the network: one for every frame, and transforms of them."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from harness import Sensor, silent_drone, wait_for_nodes
from harness_observer import COFFEE_IDS, FRAME_ID, RELIABLE, System, running
from std_msgs.msg import Bool
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.msg import MarkerTrack
from retrolidar_ros.nodes.conversion import covariance_of, to_ns, vector_of
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.settings.files import shared_file


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    directory = tmp_path_factory.mktemp('tracks')
    with running(directory, '/tracks') as one:
        one.start('driver', serial_port=one.port)
        one.start('detector', tf_source='tracks')
        wait_for_nodes(one)
        with Sensor(load_scene('coffee'), one.port):
            yield one


def test_every_frame_has_a_track_of_every_marker(system: System) -> None:
    with (
        system.subscribed(MarkerTrack, 'tracks') as tracks,
        system.subscribed(MarkerArray, 'marker_array') as arrays,
    ):
        system.wait(lambda: {one.id for one in tracks} >= COFFEE_IDS, 'tracks of all')
        seen = len(tracks)
        system.wait(lambda: len(tracks) > seen + 3 * 60 and len(arrays) > 20, 'tracks and shapes')
    frames = {to_ns(message.header.stamp) for message, _ in system.frames}
    own = [one for one in tracks[seen:] if one.id == min(COFFEE_IDS)]
    stamps = [to_ns(one.header.stamp) for one in own]
    rate_hz = (len(own) - 1) / (1e-9 * (stamps[-1] - stamps[0]))
    assert rate_hz > 0.9 / load_scene('coffee').sensor.period_s
    for one in own:
        stamp_ns = to_ns(one.header.stamp)
        assert stamp_ns in frames
        assert (one.header.frame_id, one.child_frame_id) == (FRAME_ID, f'marker_{one.id}')
        assert to_ns(one.first) < to_ns(one.last) <= stamp_ns
        assert one.presence > 0
        assert (covariance_of(one.pose).diagonal() > 0).all()
        assert (covariance_of(one.twist).diagonal() > 0).all()
        distance_m = np.linalg.norm(vector_of(one.pose.pose.position))
        assert distance_m == pytest.approx(one.range, rel=1e-6)
    # Shapes move with them.
    stamps = [to_ns(array.markers[0].header.stamp) for array in arrays]
    assert np.median(np.diff(stamps)) < 0.15e9


def test_transforms_are_of_tracks_and_of_nothing_else(system: System) -> None:
    system.wait(lambda: len(system.markers) > 3, 'detections, which send no transforms')
    system.wait_for_transforms(*(f'marker_{one}' for one in COFFEE_IDS))
    with system.subscribed(MarkerTrack, 'tracks') as tracks:
        system.wait(lambda: len(tracks) > 100, 'tracks')
        newest_ns = to_ns(tracks[-1].header.stamp)
        system.wait(lambda: to_ns(system.transforms[-1].header.stamp) >= newest_ns, 'transforms')
    sent = {(one.child_frame_id, to_ns(one.header.stamp)) for one in system.transforms}
    followed = {(one.child_frame_id, to_ns(one.header.stamp)) for one in tracks}
    assert followed <= sent
    assert len(sent) == len(system.transforms)  # none was sent twice
    # Frames may be lost on their way to this test, but not to the detector.
    frames_ns = np.unique([to_ns(message.header.stamp) for message, _ in system.frames])
    for stamp_ns in {stamp_ns for _, stamp_ns in sent} - {*frames_ns.tolist()}:
        after = int(np.searchsorted(frames_ns, stamp_ns))
        gap_ns = np.diff(frames_ns[max(after - 1, 0) : after + 1])
        assert not gap_ns.size or gap_ns[0] > 1.5e9 * SENSOR.period_s


def test_tracks_can_be_fewer(system: System) -> None:
    system.services.set('detector', max_track_rate=5.0)
    with system.subscribed(MarkerTrack, 'tracks') as tracks:
        system.wait(lambda: sum(one.id == 2073 for one in tracks) > 10, 'tracks')
    system.services.set('detector', max_track_rate=0.0)
    stamps = [to_ns(one.header.stamp) for one in tracks if one.id == 2073]
    assert np.median(np.diff(stamps[3:])) == pytest.approx(0.2e9, rel=0.15)


def test_tasks_may_take_tracks_for_readings(system: System) -> None:
    names = ', '.join(f'marker_{one}' for one in sorted(COFFEE_IDS))
    ready = system.collect(Bool, 'coffee/ready')
    system.start('coffee', source='tracks', objects=f'[{names}]', max_stddev=0.5)
    system.wait(lambda: bool(ready) and ready[-1].data, 'all objects')
    system.stop('coffee')


def test_a_marker_that_falls_silent_is_overdue_within_a_second(tmp_path: Path) -> None:
    """The detector lets it go within a second of frames, however late these come."""
    packets = 3
    scene = load_scene(str(silent_drone(tmp_path, start_s=0.5, packets=packets)))
    with running(tmp_path, '/silent') as one:
        one.start('driver', serial_port=one.port)
        one.start('detector', marker_file=shared_file('config/markers.yaml'))
        one.start('heartbeat', source='tracks', overdue_after=0.45)
        alive = one.collect(Bool, 'heartbeat/alive')
        tracks = one.collect(MarkerTrack, 'tracks', RELIABLE)
        wait_for_nodes(one)
        one.wait(lambda: bool(one.statuses['heartbeat: markers']), 'the heartbeat')
        with Sensor(scene, one.port):
            one.wait(lambda: bool(alive) and alive[-1].data, 'life')
            one.wait(lambda: not alive[-1].data, 'silence to be noticed')
        one.wait(lambda: bool(tracks), 'the tracks that were there')
        end_ns = to_ns(tracks[0].first) + round(packets * 31e9 * scene.markers[0].bit_period_s)
        assert to_ns(tracks[-1].header.stamp) - end_ns < 1e9
        assert 'drone is overdue' in one.log('heartbeat')
