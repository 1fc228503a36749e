# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What experiments are made of: recordings and random rooms, cameras and readers of markers."""

import ctypes.util
import math
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evaluation.bench.disturbances import BLOCK_FRAMES, FAMILY, Member
from evaluation.bench.judging import BOTH
from evaluation.bench.recordings import SILENCE_BITS, record
from evaluation.bench.room_markers import (
    FOREIGN,
    MOTIONS,
    SENDINGS,
    Course,
    room_marker,
)
from evaluation.bench.room_scene import Room, RoomSimulation, draw_room
from evaluation.bench.room_truth import COMPANY, SIGNALS, Scored, packets_of, score
from evaluation.bench.rooms import play
from evaluation.bench.stresses import PLAIN
from evaluation.experiments import time_to_id
from evaluation.peers import camera
from evaluation.peers.visual_markers import (
    APRILTAG,
    APRILTAG_FINE,
    QR,
    AprilTagReader,
    View,
    find_readers,
    read_pictures,
)
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, PACKET_S, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Surface
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.model import Status

DURATION_S = 20.0
PLACE_M = 1.0 * SENSOR.grid.directions[5]


def one_marker(sending: str = 'repeating', seed: int = 0) -> Room:
    """Return the reference scene with one marker at 1 m that always sends."""
    rng = np.random.default_rng(seed)
    bit_s = BIT_PERIOD_S * (2.5 if sending == 'period' else 1.0)
    marker = room_marker(sending, Course('still', PLACE_M), bit_s, -0.4, DURATION_S, rng)
    wall = Surface(1.05, WALL_SIGNAL)
    scene = Scene(duration_s=DURATION_S, sensor=SENSOR, surfaces=(wall,))
    return Room(scene, BIT_PERIOD_S, (marker,))


def simulated(room: Room) -> tuple[RoomSimulation, Recording]:
    simulation = RoomSimulation(room, np.random.default_rng(1))
    return simulation, simulation.run(room.scene.duration_s)


def readings(recording: Recording) -> list[Detection]:
    return create_detector('joint', recording.grid).update_all(recording)


def scored(room: Room, id_: int | None = None) -> Scored:
    """Return the score of what is read of a room, or of that read as another ID."""
    simulation, recording = simulated(room)
    found = [replace(one, id=one.id if id_ is None else id_) for one in readings(recording)]
    return score(simulation, packets_of(simulation), found)


def test_a_room_is_that_of_its_seed() -> None:
    frames = []
    for seed, number in ((7, 3), (7, 4), (8, 3)):
        rng = np.random.default_rng([seed, number])
        room = draw_room(rng)
        frames.append(RoomSimulation(room, rng).run(5.0))
    assert not any(np.array_equal(frames[0].signal, other.signal) for other in frames[1:])
    one, again = (play(number=3, seed=7) for _ in range(2))
    assert one.scored == again.scored


def test_all_that_is_named_is_drawn() -> None:
    drawn = [draw_room(np.random.default_rng([1, number])) for number in range(150)]
    markers = [marker for room in drawn for marker in room.markers]
    assert {marker.sending for marker in markers} == {*SENDINGS, *FOREIGN}
    assert {marker.course.motion for marker in markers} == set(MOTIONS)
    assert any(math.isfinite(marker.present_s[0]) for marker in markers)
    assert {len(room.markers) for room in drawn} == {1, 2, 3, 4, 16}
    assert {room.scene.sensor.grid.rows for room in drawn} == {4, 8}
    assert {room.cloth[0] > 0 for room in drawn} == {True, False}
    for what in ('surfaces', 'moving_surfaces'):
        assert {bool(getattr(room.scene, what)) for room in drawn} == {True, False}
    for what in ('lost', 'abnormal', 'jitter_s'):
        assert {getattr(room.scene.sensor, what) > 0 for room in drawn} == {True, False}


def test_what_is_said_to_be_sent_is_in_the_light_and_silence_is_bright() -> None:
    room = one_marker('pauses')
    simulation, recording = simulated(room)
    sent = packets_of(simulation)
    assert {(one.zone, one.company, one.signal) for one in sent} == {(5, COMPANY[0], SIGNALS[-1])}
    time_s, signal, (marker,) = 1e-9 * recording.stamp_ns, recording.signal[:, 5], room.markers
    for one in (one for one in sent if one.whole):
        middles_s = one.start_s + marker.bit_s * (np.arange(PACKET_BITS) + 0.5)
        bits = np.interp(middles_s, time_s, signal)
        np.testing.assert_array_equal(bits < bits.max() / 2, packet(one.id) == 1)
    ends_s = [(one.start_s - 0.02, one.end_s + 0.04) for one in sent]
    silent = np.array([not any(start < at < end for start, end in ends_s) for at in time_s])
    assert silent.any()
    assert signal[silent].min() > 0.8 * signal.max()
    partial = [one for one in sent if not one.whole]
    assert partial[0].start_s == 0.0
    assert all(one.end_s > DURATION_S - 3 for one in partial[1:])


def test_an_id_that_was_not_sent_is_wrong() -> None:
    room = one_marker()
    other = int(USABLE_IDS[USABLE_IDS.searchsorted(room.markers[0].ids[0]) - 1])
    result = scored(room, other)
    assert result.readings
    assert not any(right for _, right in result.readings)
    assert not any(result.read)
    assert {one.true_ids for one in result.wrong} == {(room.markers[0].ids[0],)}
    assert {(one.near, one.motion, one.signal) for one in result.wrong} == {
        ('repeating', 'still', 'bright')
    }


@pytest.mark.parametrize(
    ('zone', 'early_packets', 'end_packets', 'right'),
    [
        (5, 0.0, 0.0, True),
        (6, 0.0, 0.0, True),
        (7, 0.0, 0.0, False),
        (5, 0.4, 0.0, True),
        (5, 0.9, 0.0, False),
        (5, 0.9, 0.9, True),
    ],
)
def test_an_id_is_right_in_its_direction_and_at_its_time_or_by_its_samples(
    zone: int, early_packets: float, end_packets: float, right: bool
) -> None:
    room = one_marker('lone', seed=3)
    simulation, recording = simulated(room)
    found = readings(recording)[0]
    start_ns = found.start_ns - round(1e9 * early_packets * PACKET_S)
    end_ns = start_ns + round(1e9 * (1 + end_packets) * PACKET_S)
    place = replace(found.place, position_m=SENSOR.grid.directions[zone])
    moved = replace(found, place=place, start_ns=start_ns, end_ns=end_ns)
    result = score(simulation, packets_of(simulation), [moved])
    assert [is_right for _, is_right in result.readings] == [right]


def test_whatever_a_foreign_marker_is_read_as_is_wrong() -> None:
    simulation, _ = simulated(one_marker('period'))
    _, recording = simulated(one_marker())
    assert packets_of(simulation) == []
    result = score(simulation, [], readings(recording))
    assert result.readings
    assert {one.near for one in result.wrong} == {'period'}
    assert len(result.wrong) == len(result.readings)


def test_lone_packets_come_after_silence_and_end_before_the_recording() -> None:
    sent = record(PLAIN, 600.0, np.random.default_rng(0))
    assert sent.start_s.min() >= SILENCE_BITS * BIT_PERIOD_S
    time_s, dark = sent.recording.stamp_ns * 1e-9, sent.recording.signal < WALL_SIGNAL + 300
    ends_s = np.array([time_s[dark[:, zone]][[0, -1]] for zone in range(16)])
    assert ends_s[:, 0] == pytest.approx(sent.start_s, abs=0.022)
    assert (ends_s[:, 1] <= sent.start_s + PACKET_BITS * BIT_PERIOD_S + 0.011).all()


def test_a_hand_hides_the_middle_of_the_packet_and_a_far_wall_its_dark_bits() -> None:
    hand = record(replace(PLAIN, hand_s=0.3), 150.0, np.random.default_rng(0))
    near = hand.recording.distance < 0.3
    middles_s = [hand.recording.stamp_ns[near[:, zone]].mean() * 1e-9 for zone in range(16)]
    assert middles_s == pytest.approx(hand.start_s + hand.packet_s / 2, abs=0.02)
    assert near.sum(axis=0) * 0.021 == pytest.approx(np.full(16, 0.3), abs=0.05)
    wall = record(replace(PLAIN, far_wall=0.5), 150.0, np.random.default_rng(0))
    assert wall.recording.signal.min(axis=0) == pytest.approx(np.full(16, 77.0), abs=25)


READERS = {reader.name: reader for reader in find_readers()[0]}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.mark.parametrize('member', FAMILY, ids=lambda member: member.name)
def test_blocks_of_a_disturbance_follow_each_other(member: Member) -> None:
    duration_s = 2.5 * BLOCK_FRAMES * SENSOR.period_s
    blocks = list(member.blocks(duration_s, np.random.default_rng(3)))
    sequence = np.concatenate([block.sequence for block in blocks])
    np.testing.assert_array_equal(sequence, np.arange(len(sequence)))
    assert len(sequence) == round(duration_s / SENSOR.period_s)
    for block in blocks:
        none = block.status == Status.NO_TARGET
        assert np.isfinite(block.signal).all()
        assert (np.isnan(block.distance) == none).all()


def test_a_marker_is_identified_no_sooner_than_a_word_after_it_came_into_view() -> None:
    sent = time_to_id.appearing(1.0, np.random.default_rng(3))
    before = sent.recording.stamp_ns < time_to_id.VIEW_S * 1e9
    assert sent.recording.signal[before].max() < WALL_SIGNAL + 15
    times_s, wrong = time_to_id.first_ids(sent, BOTH['joint'])
    assert np.isfinite(times_s).all()
    assert times_s.min() > 19 * BIT_PERIOD_S  # seven bits of the preamble and twelve of the ID
    assert wrong <= 1  # a packet that comes into view half sent may look like another


def test_photoelectrons_follow_light_and_time() -> None:
    # By hand: 100 lux on paper of 0.9 through f/1.8 with 0.9 of the light leave 6.25 lux; for
    # 1/30 s on (1/300 mm)², half of 683 W⁻¹ lm of 555 nm photons count.
    photons_j = 6.62607e-34 * 2.99792e8 / 555e-9
    expected = 0.5 * 6.25 / 683 / photons_j * (1e-3 / 300) ** 2 / 30
    assert camera.paper_electrons(100, 1 / 30) == pytest.approx(expected, rel=1e-4)
    assert camera.paper_electrons(50, 1 / 60) == pytest.approx(expected / 4, rel=1e-4)


def test_missing_zbar_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.startswith('pyzbar')]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(ctypes.util, 'find_library', lambda name: None)
    readers, missing = find_readers()
    assert [reader.name for reader in readers] == [APRILTAG, APRILTAG_FINE]
    assert list(missing) == [QR]
    assert 'apt install libzbar0' in missing[QR]


class Liar(AprilTagReader):
    """Reads another ID than is there."""

    def read(self, picture: Any, centre_px: Any, size_m: float) -> Any:
        (seen,) = super().read(picture, centre_px, size_m)
        return [seen._replace(id=seen.id + 1)]


def test_right_and_wrong_ids_are_counted(rng: np.random.Generator) -> None:
    liar = Liar('liar', 2.0)
    results = read_pictures([*READERS.values(), liar], camera.Background(rng), 4, rng, View(0.6))
    for name in READERS:
        found = results[name]
        assert (found['right']['hits'], found['wrong']['hits']) == (4, 0)
        assert found['error_mm'] is not None
        assert found['error_mm']['largest'] < 6
    found = results[liar.name]
    assert (found['right']['hits'], found['wrong']['hits']) == (0, 4)
    assert found['error_mm'] is None


@pytest.mark.parametrize(
    ('view', 'hits'),
    [
        (View(1.0), 5),
        (View(1.0, lux=0.01), 0),
        (View(1.0, yaw_deg=85), 0),
        (View(1.0, pitch_deg=85), 0),
        (View(1.0, speed_m_s=0.6), 0),
    ],
)
def test_tags_end_dark_turned_and_blurred(view: View, hits: int, rng: np.random.Generator) -> None:
    results = read_pictures([READERS[APRILTAG]], camera.Background(rng), 5, rng, view)
    assert results[APRILTAG]['right']['hits'] == hits
