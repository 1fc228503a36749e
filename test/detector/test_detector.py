# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every method promises."""

from dataclasses import replace

import numpy as np
import pytest
from harness_detector import (
    GRID,
    ID,
    OTHER_ID,
    ZONE,
    a_scene,
    and_another,
    every_method,
    ids,
    lone,
    repeating,
    run,
    simulate,
)

from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.sensor.frame import Recording, Status, ZoneGrid


@every_method
def test_a_lone_packet_is_read_at_its_last_frame(method: str) -> None:
    detector = create_detector(method, GRID)
    ((detection, read_ns),) = (
        (detection, frame.stamp_ns) for frame in lone() for detection in detector.update(frame)
    )
    assert detection.id == ID
    assert detection.zones == (ZONE,)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)
    assert detection.place.position_m == pytest.approx(1.2 * GRID.directions[ZONE], abs=2e-3)
    assert detection.start_ns == pytest.approx(2.0e9, abs=25e6)
    # The place holds at the mean time of the bright samples.
    light = 1 - packet(ID)
    middle_bits = (light * (np.arange(31) + 0.5)).sum() / light.sum()
    middle_ns = 2.0e9 + (middle_bits if method == 'joint' else 15.5) * 42e6
    assert detection.stamp_ns == pytest.approx(middle_ns, abs=50e6)
    assert detection.end_ns == read_ns == pytest.approx(2.0e9 + 31 * 42e6, abs=25e6)
    assert detection.bit_period_s == pytest.approx(0.042, rel=0.003)
    assert detection.packets == 1
    assert 0.9 < detection.score <= 1
    (noiseless,) = run(simulate(replace(a_scene(), sensor=Sensor())), method)
    assert noiseless.place.range_stddev_m > 0
    assert np.linalg.eigvalsh(noiseless.place.covariance).min() > 0


@every_method
def test_the_snr_is_that_of_bits_in_step_with_the_frames(method: str) -> None:
    (detection,) = run(simulate(a_scene(start_s=96 * 0.021, response=None)), method)
    amplitude = 360 * 1.2**-3.8
    expected_db = 20 * np.log10(amplitude / np.sqrt(4.6 + 0.22 * (4 + amplitude / 2)))
    assert detection.snr_db == pytest.approx(expected_db, abs=1.5)
    assert detection.score > 0.99


@every_method
@pytest.mark.parametrize('rows', [4, 8])
def test_both_zone_grids_are_read(method: str, rows: int) -> None:
    grid = ZoneGrid(rows, rows)
    scene = a_scene(position_m=(0.05, 0.04, 1.0), packets=None)
    scene = replace(scene, sensor=replace(scene.sensor, grid=grid), surfaces=())
    assert ID in ids(run(simulate(scene), create_detector(method, grid)))


@every_method
def test_a_marker_that_never_pauses_is_read_packet_by_packet(method: str) -> None:
    starts = np.array([one.start_ns for one in run(repeating(14.0), method) if one.id == ID])
    assert len(starts) >= 8
    assert np.abs(np.diff(starts) / 1.302e9 - np.rint(np.diff(starts) / 1.302e9)).max() < 0.02


@every_method
def test_a_detector_begins_anew_when_time_jumps(method: str) -> None:
    detector = create_detector(method, GRID)
    late = [replace(frame, stamp_ns=frame.stamp_ns + 10**12) for frame in lone()]
    # Played again, a thousand seconds back, two thousand forward.
    for frames in (lone(), lone(), late, lone(), late):
        assert ids(run(frames, detector)) == [ID]


@every_method
def test_frames_of_another_grid_are_refused(method: str) -> None:
    detector, frames = create_detector(method, ZoneGrid(8, 8)), simulate(a_scene(), 0.1)
    with pytest.raises(ValueError, match='4x4 zones came to a detector for 8x8'):
        run(frames, detector)
    with pytest.raises(ValueError, match='4x4 zones came to a detector for 8x8'):
        detector.update_all(frames)


@every_method
@pytest.mark.parametrize('length', [1, 7, 60, 1000])
def test_blocks_follow_each_other_without_a_seam(method: str, length: int) -> None:
    frames, detector = list(simulate(and_another(a_scene()))), create_detector(method, GRID)
    read: list[Detection] = []
    for first in range(0, len(frames), length):
        read += detector.update_all(Recording.of(frames[first : first + length]))
    # What becomes certain within a block is read at its end, so only the order may differ.
    assert sorted(ids(read)) == [ID, OTHER_ID]


@every_method
@pytest.mark.parametrize('garbage', [np.nan, np.inf, -1e30, 3e38])
def test_garbage_neither_stops_nor_fools_a_detector(method: str, garbage: float) -> None:
    recording = repeating(8.0)
    signal, distance = recording.signal.copy(), recording.distance.copy()
    status = recording.status.copy()
    signal[100:110], distance[100:110] = garbage, garbage
    status[105:110] = 77  # the other half claims to be normal
    spoilt = replace(recording, signal=signal, distance=distance, status=status)
    for read in (run(spoilt, method), create_detector(method, GRID).update_all(spoilt)):
        assert set(ids(read)) == {ID}
        late = [d for d in read if d.start_ns > recording.stamp_ns[110]]
        assert len(late) >= 2
        for d in late:
            assert np.isfinite([d.score, d.snr_db, d.likelihood, d.place.range_m]).all()


@every_method
@pytest.mark.parametrize('distance_m', [0.0, -0.5, np.inf, -np.inf, 3e38, 8.192])
@pytest.mark.parametrize('share', [0.3, 1.0])
def test_impossible_distances_are_erasures(method: str, distance_m: float, share: float) -> None:
    recording = repeating(5.0)
    hit = np.random.default_rng(4).random(recording.distance.shape) < share
    spoilt = replace(recording, distance=np.where(hit, np.float32(distance_m), recording.distance))
    single, together = (create_detector(method, GRID) for _ in range(2))
    read = [*run(spoilt, single), *together.update_all(spoilt)]
    assert single.counts.impossible == together.counts.impossible == np.count_nonzero(hit)
    assert all(0 < detection.place.range_m < 4 for detection in read)
    assert bool(read) == (share < 1)


@every_method
def test_frames_of_one_stamp_count_once(method: str) -> None:
    stuck = replace(lone(), stamp_ns=np.full_like(lone().stamp_ns, lone().stamp_ns[0]))
    twice = Recording.of([frame for frame in lone() for _ in range(2)])
    for recording, expected in ((stuck, []), (twice, [ID])):
        assert ids(run(recording, method)) == expected
        assert ids(create_detector(method, GRID).update_all(recording)) == expected


@every_method
def test_zones_that_never_see_anything_do_no_harm(method: str) -> None:
    for blind, expected in ((np.arange(GRID.zones) != ZONE, [ID]), (slice(None), [])):
        signal, distance = lone().signal.copy(), lone().distance.copy()
        status = lone().status.copy()
        signal[:, blind], distance[:, blind], status[:, blind] = 0, np.nan, Status.NO_TARGET
        partly = replace(lone(), signal=signal, distance=distance, status=status)
        assert ids(run(partly, method)) == expected
        assert ids(create_detector(method, GRID).update_all(partly)) == expected


@pytest.mark.parametrize(
    ('name', 'values', 'message'),
    [
        ('bit_period_s', (0.0, -0.042, np.inf, np.nan), 'bit_period of'),
        ('false_ids_per_hour', (0, -1, np.nan), 'false_ids_per_hour of'),
        ('max_packets', (0, 9, -1), r'max_packets of \S+: it must be 1 to 8'),
        ('registered_ids', ([0, 4095], []), 'no usable ID|must be an integer'),
        ('registered_ids', ([ID, -1], [ID, 4096]), r'marker ID (-1|4096) is outside'),
    ],
)
@every_method
def test_impossible_parameters(
    method: str, name: str, values: tuple[object, ...], message: str
) -> None:
    for value in values:
        with pytest.raises(ValueError, match=message):
            create_detector(method, GRID, **{name: value})  # type: ignore[arg-type]


def test_an_impossible_request_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown method 'magic'; there is joint, paper"):
        create_detector('magic', GRID)
    with pytest.raises(ValueError, match='likelihood_threshold of nan'):
        create_detector('paper', GRID, likelihood_threshold=float('nan'))
    for floor, slope in ((0.0, 0.22), (4.6, -0.1), (np.nan, 0.22), (4.6, np.nan)):
        with pytest.raises(ValueError, match='the floor must be positive'):
            create_detector('joint', GRID, noise=NoiseLaw(floor, slope))


@every_method
def test_only_registered_ids_are_read(method: str) -> None:
    others = [identity for identity in range(1, 200) if identity != ID]
    assert run(lone(), create_detector(method, GRID, registered_ids=others)) == []
    assert ids(run(lone(), create_detector(method, GRID, registered_ids=[*others, ID]))) == [ID]


@every_method
@pytest.mark.parametrize('gap', [1, 13, 14, 61, 62, 63, 76, 77, 200, 10_000])
def test_a_gap_of_any_length_costs_the_packet_at_most(method: str, gap: int) -> None:
    frames = list(repeating(14.0))
    begin = next(i for i, frame in enumerate(frames) if frame.stamp_ns >= 2_600_000_000)
    late = [replace(frame, stamp_ns=frame.stamp_ns + gap * 21_000_000) for frame in frames[begin:]]
    detections = run([*frames[:begin], *late], method)
    assert [d.id for d in detections if d.start_ns > late[0].stamp_ns].count(ID) >= 5


@every_method
@pytest.mark.parametrize(('before', 'after'), [(4, 40), (40, 4), (10, 100)])
def test_a_step_of_the_signal_is_no_marker(method: str, before: float, after: float) -> None:
    recording = simulate(replace(a_scene(), markers=()), 8.0)
    step = np.where(np.arange(len(recording)) < 190, before - 4.0, after - 4.0)
    stepping = replace(recording, signal=recording.signal + step[:, None].astype(np.float32))
    assert not set(ids(run(stepping, method))) & {0, 4095}
