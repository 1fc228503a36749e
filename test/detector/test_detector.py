# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from retrolidar_ros.detector import METHODS, Detection, Detector, create_detector
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.detector.paper.baseline import silent_level
from retrolidar_ros.detector.paper.demodulation import fit_packets, threshold_bits
from retrolidar_ros.detector.paper.preamble import fit_preamble
from retrolidar_ros.marker.code import PREAMBLE, packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Response, Sensor, Surface
from retrolidar_ros.sensor.frame import Floats, Frame, Recording, Status, ZoneGrid

# Repeated or alone, this ID shows no second preamble.
ID = 2073
ZONE = 9
GRID = ZoneGrid()


def a_scene(**marker: object) -> Scene:
    """Return a scene with one marker at 1.2 m in the middle of `ZONE`, and a wall behind it."""
    x, y, z = (1.2 * GRID.directions[ZONE]).tolist()
    settings = {'id': ID, 'position_m': (x, y, z), 'name': 'marker', 'start_s': 2.0, 'packets': 1}
    return Scene(
        sensor=Sensor(noise=Noise(floor=4.6, slope=0.22)),
        markers=(
            Marker(**{**settings, 'response': Response(0.0005, 0.0035), **marker}),  # type: ignore[arg-type]
        ),
        surfaces=(Surface(float(1.2 * GRID.z_per_range[ZONE]), 4.0),),
    )


def run(frames: Iterable[Frame], detector: Detector) -> list[Detection]:
    return [detection for frame in frames for detection in detector.update(frame)]


def simulate(scene: Scene, duration_s: float = 4.5, seed: int = 3) -> Recording:
    return Simulation(scene, np.random.default_rng(seed)).run(duration_s)


@pytest.mark.parametrize('method', METHODS)
def test_every_method_reads_identity_place_and_time_of_a_lone_packet(method: str) -> None:
    recording = simulate(a_scene())
    detections = run(recording, create_detector(method, GRID))
    assert [detection.id for detection in detections] == [ID]
    (detection,) = detections
    assert detection.zones == (ZONE,)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)
    assert detection.place.position_m == pytest.approx(1.2 * GRID.directions[ZONE], abs=2e-3)
    assert detection.start_ns == pytest.approx(2.0e9, abs=25e6)
    # The place holds at the mean time of the bright samples.
    light = 1 - packet(ID)
    middle_bits = (light * (np.arange(31) + 0.5)).sum() / light.sum()
    middle_ns = 2.0e9 + (middle_bits if method == 'joint' else 15.5) * 42e6
    assert detection.stamp_ns == pytest.approx(middle_ns, abs=50e6)
    assert detection.end_ns == pytest.approx(2.0e9 + 31 * 42e6, abs=25e6)
    assert detection.bit_period_s == pytest.approx(0.042, rel=0.003)
    assert detection.packets == 1
    assert 0.9 < detection.score <= 1


@pytest.mark.parametrize('method', METHODS)
def test_every_method_measures_the_snr_of_bits_in_step_with_the_frames(method: str) -> None:
    scene = a_scene(start_s=96 * 0.021, response=None)
    (detection,) = run(simulate(scene), create_detector(method, GRID))
    amplitude = 360 * 1.2**-3.8
    expected_db = 20 * np.log10(amplitude / np.sqrt(4.6 + 0.22 * (4 + amplitude / 2)))
    assert detection.snr_db == pytest.approx(expected_db, abs=1.5)
    assert detection.score > 0.99


@pytest.mark.parametrize('method', METHODS)
def test_every_method_decides_with_the_last_frame_of_the_packet(method: str) -> None:
    detector = create_detector(method, GRID)
    for frame in simulate(a_scene()):
        for detection in detector.update(frame):
            assert detection.end_ns == frame.stamp_ns


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('rows', [4, 8])
def test_every_method_reads_both_zone_grids(method: str, rows: int) -> None:
    grid = ZoneGrid(rows, rows)
    scene = a_scene(position_m=(0.05, 0.04, 1.0), packets=None)
    scene = replace(scene, sensor=replace(scene.sensor, grid=grid), surfaces=())
    assert ID in {d.id for d in run(simulate(scene), create_detector(method, grid))}


@pytest.mark.parametrize('method', METHODS)
def test_every_method_reads_a_marker_that_never_pauses(method: str) -> None:
    detections = run(
        simulate(a_scene(start_s=0.0, packets=None), 14.0), create_detector(method, GRID)
    )
    read = [detection for detection in detections if detection.id == ID]
    assert len(read) >= 8
    starts = np.array([detection.start_ns for detection in read])
    assert np.abs(np.diff(starts) / 1.302e9 - np.rint(np.diff(starts) / 1.302e9)).max() < 0.02


@pytest.mark.parametrize('method', METHODS)
def test_every_method_begins_anew_when_time_jumps(method: str) -> None:
    recording = simulate(a_scene())
    detector = create_detector(method, GRID)
    late = [replace(frame, stamp_ns=frame.stamp_ns + 10**12) for frame in recording]
    # The stamps go back by a thousand seconds, then forward by two thousand.
    for frames in (late, list(recording), late):
        assert [detection.id for detection in run(frames, detector)] == [ID]


@pytest.mark.parametrize('method', METHODS)
def test_a_frame_of_another_grid_is_refused(method: str) -> None:
    detector = create_detector(method, ZoneGrid(8, 8))
    with pytest.raises(ValueError, match='4x4 zones came to a detector for 8x8'):
        run(simulate(a_scene(), 0.1), detector)


@pytest.mark.parametrize('method', METHODS)
def test_many_frames_at_a_time_read_the_same_as_one_by_one(method: str) -> None:
    scene = a_scene(start_s=0.0, packets=None)
    other = replace(
        scene.markers[0], id=2096, position_m=(0.39, -0.39, 1.2), start_s=2.3, packets=1
    )
    recording = simulate(replace(scene, markers=(*scene.markers, other)), 8.0)
    one_by_one = run(recording, create_detector(method, GRID))
    together = create_detector(method, GRID).update_all(recording)
    assert {detection.id for detection in together} == {ID, 2096}
    # What becomes certain within a block is told at its end, so only the order may differ.
    assert {d.id: d.zones for d in together} == {d.id: d.zones for d in one_by_one}
    for identity in (ID, 2096):
        counts = [sum(d.id == identity for d in read) for read in (together, one_by_one)]
        assert abs(counts[0] - counts[1]) <= 1


@pytest.mark.parametrize('method', METHODS)
def test_blocks_of_any_length_follow_each_other_without_a_seam(method: str) -> None:
    frames = list(simulate(a_scene()))
    for length in (1, 7, 60, 1000):
        detector = create_detector(method, GRID)
        read: list[Detection] = []
        for first in range(0, len(frames), length):
            read += detector.update_all(Recording.of(frames[first : first + length]))
        assert [detection.id for detection in read] == [ID]


@pytest.mark.parametrize('method', METHODS)
def test_a_recording_of_another_grid_is_refused(method: str) -> None:
    detector = create_detector(method, ZoneGrid(8, 8))
    with pytest.raises(ValueError, match='4x4 zones came to a detector for 8x8'):
        detector.update_all(simulate(a_scene(), 0.1))


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('garbage', [np.nan, np.inf, -1e30, 3e38])
def test_garbage_neither_stops_nor_fools_a_detector(method: str, garbage: float) -> None:
    recording = simulate(a_scene(start_s=0.0, packets=None), 8.0)
    signal, distance = recording.signal.copy(), recording.distance.copy()
    status = recording.status.copy()
    hit = slice(100, 110)
    signal[hit], distance[hit] = garbage, garbage
    status[105:110] = 77  # the other half claims to be normal
    spoilt = replace(recording, signal=signal, distance=distance, status=status)
    for read in (
        run(spoilt, create_detector(method, GRID)),
        create_detector(method, GRID).update_all(spoilt),
    ):
        assert {detection.id for detection in read} == {ID}
        late = [d for d in read if d.start_ns > recording.stamp_ns[110]]
        assert len(late) >= 2
        for d in late:
            assert np.isfinite([d.score, d.snr_db, d.likelihood, d.place.range_m]).all()


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('distance_m', [0.0, -0.5, np.inf, -np.inf, 3e38, 8.192])
@pytest.mark.parametrize('share', [0.3, 1.0])
def test_impossible_distances_are_erasures_and_counted(
    method: str, distance_m: float, share: float
) -> None:
    recording = simulate(a_scene(start_s=0.0, packets=None), 8.0)
    hit = np.random.default_rng(4).random(recording.distance.shape) < share
    spoilt = replace(recording, distance=np.where(hit, np.float32(distance_m), recording.distance))
    single, together = (create_detector(method, GRID) for _ in range(2))
    read = [*run(spoilt, single), *together.update_all(spoilt)]
    assert single.counts.impossible == together.counts.impossible == np.count_nonzero(hit)
    assert all(0 < detection.place.range_m < 4 for detection in read)
    assert bool(read) == (share < 1)


@pytest.mark.parametrize('method', METHODS)
def test_frames_of_one_stamp_count_once(method: str) -> None:
    recording = simulate(a_scene())
    stuck = replace(recording, stamp_ns=np.full_like(recording.stamp_ns, recording.stamp_ns[0]))
    assert run(stuck, create_detector(method, GRID)) == []
    assert create_detector(method, GRID).update_all(stuck) == []
    twice = Recording.of([frame for frame in recording for _ in range(2)])
    read = create_detector(method, GRID).update_all(twice)
    assert [detection.id for detection in read] == [ID]


@pytest.mark.parametrize('method', METHODS)
def test_zones_that_never_see_anything_do_no_harm(method: str) -> None:
    recording = simulate(a_scene())
    blind = np.arange(GRID.zones) != ZONE
    signal, distance = recording.signal.copy(), recording.distance.copy()
    status = recording.status.copy()
    signal[:, blind], distance[:, blind], status[:, blind] = 0, np.nan, Status.NO_TARGET
    partly = replace(recording, signal=signal, distance=distance, status=status)
    assert [detection.id for detection in run(partly, create_detector(method, GRID))] == [ID]
    nothing = replace(
        recording,
        signal=np.zeros_like(signal),
        distance=np.full_like(distance, np.nan),
        status=np.full_like(status, Status.NO_TARGET),
    )
    assert run(nothing, create_detector(method, GRID)) == []
    assert create_detector(method, GRID).update_all(nothing) == []


def test_an_impossible_request_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown method 'magic'; there is joint, paper"):
        create_detector('magic', GRID)
    with pytest.raises(ValueError, match='likelihood_threshold of nan'):
        create_detector('paper', GRID, likelihood_threshold=float('nan'))


@pytest.mark.parametrize('method', METHODS)
def test_every_method_refuses_impossible_parameters(method: str) -> None:
    for period_s in (0.0, -0.042, np.inf, np.nan):
        with pytest.raises(ValueError, match='bit_period of'):
            create_detector(method, GRID, bit_period_s=period_s)
    for budget in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match='false_ids_per_hour of'):
            create_detector(method, GRID, false_ids_per_hour=budget)
    for packets in (0, 9, -1):
        with pytest.raises(ValueError, match=f'max_packets of {packets}: it must be 1 to 8'):
            create_detector(method, GRID, max_packets=packets)
    for ids in ([0, 4095], []):
        with pytest.raises(ValueError, match=r'no usable ID|must be an integer'):
            create_detector(method, GRID, registered_ids=ids)
    for outside in (-1, 4096):
        with pytest.raises(ValueError, match=f'marker ID {outside} is outside'):
            create_detector(method, GRID, registered_ids=[ID, outside])


def test_an_impossible_noise_law_is_refused() -> None:
    for floor, slope in ((0.0, 0.22), (4.6, -0.1), (np.nan, 0.22), (4.6, np.nan)):
        with pytest.raises(ValueError, match='the floor must be positive'):
            create_detector('joint', GRID, noise=NoiseLaw(floor, slope))


@pytest.mark.parametrize('method', METHODS)
def test_only_registered_ids_are_read(method: str) -> None:
    recording = simulate(a_scene())
    others = [identity for identity in range(1, 200) if identity != ID]
    assert run(recording, create_detector(method, GRID, registered_ids=others)) == []
    among = create_detector(method, GRID, registered_ids=[*others, ID])
    assert [detection.id for detection in run(recording, among)] == [ID]


def test_the_papers_method_counts_what_it_reads_but_is_not_registered() -> None:
    scene = a_scene()
    other = replace(scene.markers[0], id=2096, position_m=(0.39, -0.39, 1.2), start_s=2.3)
    recording = simulate(replace(scene, markers=(*scene.markers, other)))
    detector = create_detector('paper', GRID, registered_ids=[2096])
    assert [detection.id for detection in run(recording, detector)] == [2096]
    counts = detector.counts
    assert counts.accepted == 1
    assert counts.rejected['unregistered'] == 1
    assert counts.candidates == counts.accepted + sum(counts.rejected.values())


def test_a_slower_bit_is_read_at_a_slower_frame_rate() -> None:
    scene = a_scene(bit_period_s=0.133, start_s=7.0)
    scene = replace(scene, sensor=replace(scene.sensor, period_s=0.0665))
    detector = create_detector('paper', GRID, bit_period_s=0.133)
    assert [d.id for d in run(simulate(scene, 14.0), detector)] == [ID]


def test_lost_frames_are_a_gap_and_not_a_shift() -> None:
    recording = list(simulate(a_scene()))
    # Second frame of a bit in the preamble and in the word, and a whole bit.
    begin = next(i for i, frame in enumerate(recording) if frame.stamp_ns >= 2_000_000_000)
    lost = {begin + 5, begin + 31, begin + 40, begin + 41}
    kept = [frame for index, frame in enumerate(recording) if index not in lost]
    (detection,) = run(kept, create_detector('paper', GRID))
    assert detection.id == ID
    assert detection.start_ns == pytest.approx(2.0e9, abs=25e6)


def test_abnormal_samples_are_not_believed() -> None:
    recording = simulate(a_scene())
    rng = np.random.default_rng(5)
    hit = rng.random(recording.signal.shape) < 0.05
    garbage = replace(
        recording,
        signal=np.where(hit, 1000.0, recording.signal).astype(np.float32),
        distance=np.where(hit, 3.9, recording.distance).astype(np.float32),
        status=np.where(hit, Status.SIGMA_TOO_HIGH, recording.status).astype(np.uint8),
    )
    detections = run(garbage, create_detector('paper', GRID))
    (detection,) = (detection for detection in detections if detection.id == ID)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)


@pytest.mark.parametrize('status', [Status.FIRST_RANGE, Status.NO_PREVIOUS_TARGET, Status.MERGED])
def test_statuses_that_a_blinking_marker_causes_are_normal(status: Status) -> None:
    recording = simulate(a_scene())
    marked = replace(recording, status=np.full_like(recording.status, status))
    assert [d.id for d in run(marked, create_detector('paper', GRID))] == [ID]


def test_range_is_the_mean_of_all_distances_of_the_packet() -> None:
    recording = simulate(a_scene())
    distance = np.random.default_rng(6).uniform(1, 2, recording.distance.shape).astype(np.float32)
    distance[::7] = np.nan
    (detection,) = run(replace(recording, distance=distance), create_detector('paper', GRID))
    used = (recording.stamp_ns >= detection.start_ns) & (recording.stamp_ns <= detection.end_ns)
    assert used.sum() == 62
    expected = np.nanmean(distance[used, ZONE]) / GRID.z_per_range[ZONE]
    assert detection.place.range_m == pytest.approx(expected, rel=1e-6)


def test_a_marker_between_zones_is_one_detection_with_the_stronger_zone_first() -> None:
    scene = a_scene(position_m=(0.004, 0.13, 1.2))  # most of it right of the middle
    (detection,) = run(simulate(scene), create_detector('paper', GRID))
    assert detection.zones == (10, 9)


def test_two_markers_are_read_at_once_in_their_own_zones() -> None:
    scene = a_scene()
    other = replace(scene.markers[0], id=2096, position_m=(0.39, -0.39, 1.2), start_s=2.3)
    detections = run(
        simulate(replace(scene, markers=(*scene.markers, other))), create_detector('paper', GRID)
    )
    assert {(d.id, d.zones[0]) for d in detections} == {(ID, ZONE), (2096, 3)}


def test_candidates_are_counted_as_read_or_refused() -> None:
    scene = replace(a_scene(), markers=())
    detector = create_detector('paper', GRID, likelihood_threshold=0.2)
    detections = run(simulate(scene, 60.0), detector)
    counts = detector.counts
    assert counts.candidates > 20
    assert counts.candidates == counts.accepted + sum(counts.rejected.values())
    # The code alone does not reject noise: 56.8 % of all words decode.
    assert 0.3 < counts.accepted / counts.candidates < 0.8
    assert 0 < len(detections) <= counts.accepted


def test_nothing_is_seen_in_a_steady_scene() -> None:
    scene = replace(a_scene(), sensor=Sensor(), markers=())
    detector = create_detector('paper', GRID)
    assert run(simulate(scene, 20.0), detector) == []
    assert detector.counts.candidates == 0


def test_darkness_is_no_marker() -> None:
    scene = Scene()
    assert run(simulate(scene, 5.0), create_detector('paper', GRID)) == []


# The stages


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def test_preamble_fit_is_the_papers_equations(rng: np.random.Generator) -> None:
    signal = rng.uniform(0, 50, (14, 5))
    d = rng.uniform(1, 50, 5)
    fit = fit_preamble(signal, d)
    p = [bit for bit in (1, 0, 1, 0, 1, 0, 1) for _ in range(2)]
    for zone in range(5):
        s = [float(value) - float(d[zone]) for value in signal[:, zone]]
        c = sum(a * b for a, b in zip(p, s, strict=True)) / sum(a * a for a in p)
        e = sum((b - c * a) ** 2 for a, b in zip(p, s, strict=True)) ** 0.5
        assert fit.c[zone] == pytest.approx(c)
        assert fit.e[zone] == pytest.approx(e)
        assert fit.likelihood[zone] == pytest.approx(c * c / ((e + 1) * d[zone]))


def test_a_zone_without_light_has_no_likelihood() -> None:
    assert fit_preamble(np.zeros((14, 1)), np.zeros(1)).likelihood.tolist() == [0.0]


def test_bits_are_decided_by_the_nearer_level(rng: np.random.Generator) -> None:
    signal = rng.uniform(0, 30, (62, 4))
    d, c = rng.uniform(20, 30, 4), rng.uniform(-20, -5, 4)
    bits = threshold_bits(signal, d, c)
    for zone in range(4):
        for bit in range(31):
            level = (signal[2 * bit, zone] + signal[2 * bit + 1, zone]) / 2
            one = abs(level - d[zone]) > abs(level - (d[zone] + c[zone]))
            assert bits[zone, bit] == one


def sent(ids: NDArray[np.int64], bright: float, dark: float) -> Floats:
    return np.repeat(np.where(packet(ids), dark, bright), 2, axis=-1).T.astype(np.float64)


def test_packet_fit_measures_amplitude_correlation_and_noise(rng: np.random.Generator) -> None:
    ids = np.array([5, 700, 4000])
    clean = fit_packets(sent(ids, 30.0, 10.0), ids)
    assert clean.amplitude == pytest.approx([20.0] * 3)
    assert clean.score == pytest.approx([1.0] * 3)
    many = np.repeat(ids, 300)
    noisy = fit_packets(sent(many, 30.0, 10.0) + 2.0 * rng.standard_normal((62, 900)), many)
    assert noisy.snr_db.mean() == pytest.approx(20.0, abs=0.2)
    assert noisy.amplitude.mean() == pytest.approx(20.0, abs=0.1)
    upside_down = fit_packets(sent(ids, 10.0, 30.0), ids)
    assert upside_down.score == pytest.approx([-1.0] * 3)


def test_silent_level_is_the_mean_before_a_marker_wakes(rng: np.random.Generator) -> None:
    silent = 30.0 + 2.0 * rng.standard_normal((62, 4000))
    level = silent_level(silent)
    exact = np.isclose(level, silent.mean(axis=0))
    assert exact.mean() > 0.8
    # Where noise looks like bits the bright half of it is taken, 0.8 deviations too high.
    assert level[~exact].mean() - 30.0 == pytest.approx(0.8 * 2.0, abs=0.3)


def test_silent_level_is_the_bright_one_while_a_marker_transmits(rng: np.random.Generator) -> None:
    ids = np.arange(1, 4095)
    assert silent_level(sent(ids, 30.0, 10.0)) == pytest.approx([30.0] * len(ids))
    noisy = sent(ids, 30.0, 10.0) + 2.0 * rng.standard_normal((62, len(ids)))
    assert silent_level(noisy).mean() == pytest.approx(30.0, abs=0.1)


def test_preamble_alternates() -> None:
    assert PREAMBLE.tolist() == [1, 0, 1, 0, 1, 0, 1]


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize('gap', [1, 13, 14, 61, 62, 63, 76, 77, 200, 10_000])
def test_a_gap_of_any_length_costs_the_packet_at_most(method: str, gap: int) -> None:
    frames = list(simulate(a_scene(packets=None), 14.0))
    begin = next(i for i, frame in enumerate(frames) if frame.stamp_ns >= 2_600_000_000)
    late = [replace(frame, stamp_ns=frame.stamp_ns + gap * 21_000_000) for frame in frames[begin:]]
    detections = run([*frames[:begin], *late], create_detector(method, GRID))
    assert [d.id for d in detections if d.start_ns > late[0].stamp_ns].count(ID) >= 5


@pytest.mark.parametrize('method', METHODS)
def test_a_recording_that_is_played_again_is_read_again(method: str) -> None:
    recording = list(simulate(a_scene()))
    detector = create_detector(method, GRID)
    for _ in range(3):
        assert [detection.id for detection in run(recording, detector)] == [ID]


@pytest.mark.parametrize('method', METHODS)
def test_a_frame_that_comes_twice_counts_once(method: str) -> None:
    twice = [frame for frame in simulate(a_scene()) for _ in range(2)]
    assert [detection.id for detection in run(twice, create_detector(method, GRID))] == [ID]


@pytest.mark.parametrize('method', METHODS)
@pytest.mark.parametrize(('before', 'after'), [(4, 40), (40, 4), (10, 100)])
def test_a_step_of_the_signal_is_no_marker(method: str, before: float, after: float) -> None:
    recording = simulate(replace(a_scene(), markers=()), 8.0)
    step = np.where(np.arange(len(recording)) < 190, before - 4.0, after - 4.0)
    stepping = replace(recording, signal=recording.signal + step[:, None].astype(np.float32))
    ids = {detection.id for detection in run(stepping, create_detector(method, GRID))}
    assert not ids & {0, 4095}


def test_a_zone_whose_first_samples_are_abnormal_begins_with_the_first_normal_one() -> None:
    recording = simulate(replace(a_scene(), markers=()), 6.0)
    status = recording.status.copy()
    status[:40] = Status.NO_TARGET
    detector = create_detector('paper', GRID)
    run(replace(recording, status=status, signal=recording.signal + np.float32(40)), detector)
    assert detector.counts.candidates == 0


def test_the_end_is_that_of_a_frame_that_was_used() -> None:
    frames = list(simulate(a_scene()))
    (detection,) = run(frames, create_detector('paper', GRID))
    last = next(i for i, frame in enumerate(frames) if frame.stamp_ns == detection.end_ns)
    (late,) = run(frames[:last] + frames[last + 30 :], create_detector('paper', GRID))
    assert late.id == ID
    assert late.end_ns == frames[last - 1].stamp_ns


def test_the_range_deviation_is_never_nothing() -> None:
    recording = simulate(replace(a_scene(), sensor=Sensor()))
    (detection,) = run(recording, create_detector('paper', GRID))
    assert detection.place.range_stddev_m > 0
    assert np.linalg.eigvalsh(detection.place.covariance).min() > 0
