# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every method promises, and what the paper's does besides."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

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
ID, OTHER_ID = 2073, 2096
ZONE = 9
GRID = ZoneGrid()

every_method = pytest.mark.parametrize('method', METHODS)


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


def and_another(scene: Scene, **marker: object) -> Scene:
    """Return a scene with a second marker, a little later and in another zone."""
    settings = {'id': OTHER_ID, 'position_m': (0.39, -0.39, 1.2), 'start_s': 2.3, **marker}
    return replace(scene, markers=(*scene.markers, replace(scene.markers[0], **settings)))  # type: ignore[arg-type]


def simulate(scene: Scene, duration_s: float = 4.5, seed: int = 3) -> Recording:
    return Simulation(scene, np.random.default_rng(seed)).run(duration_s)


@cache
def lone() -> Recording:
    """Return the frames of a lone packet."""
    return simulate(a_scene())


@cache
def repeating(duration_s: float) -> Recording:
    """Return the frames of a marker that never pauses."""
    return simulate(a_scene(start_s=0.0, packets=None), duration_s)


def run(frames: Iterable[Frame], detector: Detector | str = 'paper') -> list[Detection]:
    """Give a detector frames one by one; return what it reads."""
    if isinstance(detector, str):
        detector = create_detector(detector, GRID)
    return [detection for frame in frames for detection in detector.update(frame)]


def ids(detections: Iterable[Detection]) -> list[int]:
    return [detection.id for detection in detections]


@every_method
def test_a_lone_packet_is_told_at_its_last_frame(method: str) -> None:
    detector = create_detector(method, GRID)
    ((detection, told_ns),) = (
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
    assert detection.end_ns == told_ns == pytest.approx(2.0e9 + 31 * 42e6, abs=25e6)
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
def test_many_frames_at_a_time_read_the_same_as_one_by_one(method: str) -> None:
    recording = simulate(and_another(a_scene(start_s=0.0, packets=None), packets=1), 8.0)
    one_by_one = run(recording, method)
    together = create_detector(method, GRID).update_all(recording)
    assert set(ids(together)) == {ID, OTHER_ID}
    # What becomes certain within a block is told at its end, so only the order may differ.
    assert {d.id: d.zones for d in together} == {d.id: d.zones for d in one_by_one}
    for identity in (ID, OTHER_ID):
        assert abs(ids(together).count(identity) - ids(one_by_one).count(identity)) <= 1


@every_method
@pytest.mark.parametrize('length', [1, 7, 60, 1000])
def test_blocks_follow_each_other_without_a_seam(method: str, length: int) -> None:
    frames, detector = list(lone()), create_detector(method, GRID)
    read: list[Detection] = []
    for first in range(0, len(frames), length):
        read += detector.update_all(Recording.of(frames[first : first + length]))
    assert ids(read) == [ID]


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
    ('settings', 'message'),
    [
        *(({'bit_period_s': value}, 'bit_period of') for value in (0.0, -0.042, np.inf, np.nan)),
        *(({'false_ids_per_hour': value}, 'false_ids_per_hour of') for value in (0, -1, np.nan)),
        *(
            ({'max_packets': value}, f'max_packets of {value}: it must be 1 to 8')
            for value in (0, 9, -1)
        ),
        *(
            ({'registered_ids': value}, 'no usable ID|must be an integer')
            for value in ([0, 4095], [])
        ),
        *(
            ({'registered_ids': [ID, value]}, f'marker ID {value} is outside')
            for value in (-1, 4096)
        ),
    ],
)
@every_method
def test_impossible_parameters(method: str, settings: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        create_detector(method, GRID, **settings)  # type: ignore[arg-type]


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


# The paper's method


@pytest.mark.parametrize(('registered', 'read'), [(None, [ID, OTHER_ID]), ([OTHER_ID], [OTHER_ID])])
def test_two_markers_are_read_at_once_or_counted_as_not_registered(
    registered: list[int] | None, read: list[int]
) -> None:
    detector = create_detector('paper', GRID, registered_ids=registered)
    detections = run(simulate(and_another(a_scene())), detector)
    assert ids(detections) == read
    assert {(d.id, d.zones[0]) for d in detections} <= {(ID, ZONE), (OTHER_ID, 3)}
    counts = detector.counts
    if registered:
        assert (counts.accepted, counts.rejected['unregistered']) == (1, 1)
    assert counts.candidates == counts.accepted + sum(counts.rejected.values())


def test_a_slower_bit_is_read_at_a_slower_frame_rate() -> None:
    scene = a_scene(bit_period_s=0.133, start_s=7.0)
    scene = replace(scene, sensor=replace(scene.sensor, period_s=0.0665))
    detector = create_detector('paper', GRID, bit_period_s=0.133)
    assert ids(run(simulate(scene, 14.0), detector)) == [ID]


def test_lost_frames_are_a_gap_and_not_a_shift() -> None:
    recording = list(lone())
    # Second frame of a bit in the preamble and in the word, and a whole bit.
    begin = next(i for i, frame in enumerate(recording) if frame.stamp_ns >= 2_000_000_000)
    lost = {begin + 5, begin + 31, begin + 40, begin + 41}
    (detection,) = run(frame for index, frame in enumerate(recording) if index not in lost)
    assert detection.id == ID
    assert detection.start_ns == pytest.approx(2.0e9, abs=25e6)


def test_abnormal_samples_are_not_believed() -> None:
    hit = np.random.default_rng(5).random(lone().signal.shape) < 0.05
    garbage = replace(
        lone(),
        signal=np.where(hit, 1000.0, lone().signal).astype(np.float32),
        distance=np.where(hit, 3.9, lone().distance).astype(np.float32),
        status=np.where(hit, Status.SIGMA_TOO_HIGH, lone().status).astype(np.uint8),
    )
    (detection,) = (detection for detection in run(garbage) if detection.id == ID)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)


@pytest.mark.parametrize('status', [Status.FIRST_RANGE, Status.NO_PREVIOUS_TARGET, Status.MERGED])
def test_statuses_that_a_blinking_marker_causes_are_normal(status: Status) -> None:
    assert ids(run(replace(lone(), status=np.full_like(lone().status, status)))) == [ID]


def test_range_is_the_mean_of_all_distances_of_the_packet() -> None:
    distance = np.random.default_rng(6).uniform(1, 2, lone().distance.shape).astype(np.float32)
    distance[::7] = np.nan
    (detection,) = run(replace(lone(), distance=distance))
    used = (lone().stamp_ns >= detection.start_ns) & (lone().stamp_ns <= detection.end_ns)
    assert used.sum() == 62
    expected = np.nanmean(distance[used, ZONE]) / GRID.z_per_range[ZONE]
    assert detection.place.range_m == pytest.approx(expected, rel=1e-6)


def test_a_marker_between_zones_is_one_detection_with_the_stronger_zone_first() -> None:
    scene = a_scene(position_m=(0.004, 0.13, 1.2))  # most of it right of the middle
    (detection,) = run(simulate(scene))
    assert detection.zones == (10, 9)


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


def test_nothing_is_seen_where_nothing_blinks() -> None:
    steady = simulate(replace(a_scene(), sensor=Sensor(), markers=()), 20.0)
    wall = simulate(replace(a_scene(), markers=()), 6.0)
    status = wall.status.copy()
    status[:40] = Status.NO_TARGET  # it begins with the first normal sample
    late = replace(wall, status=status, signal=wall.signal + np.float32(40))
    for recording in (steady, simulate(Scene(), 5.0), late):
        detector = create_detector('paper', GRID)
        assert run(recording, detector) == []
        assert detector.counts.candidates == 0


def test_the_end_is_that_of_a_frame_that_was_used() -> None:
    frames = list(lone())
    (detection,) = run(frames)
    last = next(i for i, frame in enumerate(frames) if frame.stamp_ns == detection.end_ns)
    (late,) = run(frames[:last] + frames[last + 30 :])
    assert late.id == ID
    assert late.end_ns == frames[last - 1].stamp_ns


# Its stages


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def test_preamble_fit_is_the_papers_equations(rng: np.random.Generator) -> None:
    assert PREAMBLE.tolist() == [1, 0, 1, 0, 1, 0, 1]
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
    assert fit_preamble(np.zeros((14, 1)), np.zeros(1)).likelihood.tolist() == [0.0]


def test_bits_are_decided_by_the_nearer_level(rng: np.random.Generator) -> None:
    signal = rng.uniform(0, 30, (62, 4))
    d, c = rng.uniform(20, 30, 4), rng.uniform(-20, -5, 4)
    level = (signal[::2] + signal[1::2]) / 2
    nearer_to_dark = np.abs(level - d) > np.abs(level - (d + c))
    np.testing.assert_array_equal(threshold_bits(signal, d, c).T, nearer_to_dark)


def sent(numbers: NDArray[np.int64], bright: float, dark: float) -> Floats:
    return np.repeat(np.where(packet(numbers), dark, bright), 2, axis=-1).T.astype(np.float64)


def test_packet_fit_measures_amplitude_correlation_and_noise(rng: np.random.Generator) -> None:
    some = np.array([5, 700, 4000])
    clean = fit_packets(sent(some, 30.0, 10.0), some)
    assert clean.amplitude == pytest.approx([20.0] * 3)
    assert clean.score == pytest.approx([1.0] * 3)
    many = np.repeat(some, 300)
    noisy = fit_packets(sent(many, 30.0, 10.0) + 2.0 * rng.standard_normal((62, 900)), many)
    assert noisy.snr_db.mean() == pytest.approx(20.0, abs=0.2)
    assert noisy.amplitude.mean() == pytest.approx(20.0, abs=0.1)
    upside_down = fit_packets(sent(some, 10.0, 30.0), some)
    assert upside_down.score == pytest.approx([-1.0] * 3)


def test_silent_level_is_the_mean_before_a_marker_wakes(rng: np.random.Generator) -> None:
    silent = 30.0 + 2.0 * rng.standard_normal((62, 4000))
    level = silent_level(silent)
    exact = np.isclose(level, silent.mean(axis=0))
    assert exact.mean() > 0.8
    # Where noise looks like bits the bright half of it is taken, 0.8 deviations too high.
    assert level[~exact].mean() - 30.0 == pytest.approx(0.8 * 2.0, abs=0.3)
    # While a marker transmits it is the bright one.
    shining = sent(np.arange(1, 4095), 30.0, 10.0)
    assert silent_level(shining) == pytest.approx([30.0] * 4094)
    noisy = shining + 2.0 * rng.standard_normal(shining.shape)
    assert silent_level(noisy).mean() == pytest.approx(30.0, abs=0.1)
