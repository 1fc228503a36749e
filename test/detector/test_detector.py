# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What every method promises; what that of the paper promises besides, and its stages."""

from dataclasses import replace
from itertools import cycle, islice
from typing import Any

import numpy as np
import pytest
from harness_frames import (
    GRID,
    ID,
    OTHER_ID,
    ZONE,
    a_scene,
    every_method,
    ids,
    lone,
    repeating,
    run,
    simulate,
)

from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.paper_stages import fit_preamble, silent_level
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.sensor.frame import Recording, ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, Status

BEYOND = (np.inf, -np.inf, -0.5)
IMPOSSIBLE = {'distance': (*BEYOND, 0.0, 8.192), 'signal': (*BEYOND, np.nan), 'ambient': ()}
STRANGE = {
    'distance': (np.nan, 1e-40, 8.191),
    'signal': (0.0, 1e-40),
    'ambient': (*BEYOND, 0.0, np.nan),
}
"""What may come, though hardly."""


@every_method
def test_a_lone_packet_is_read_once_by_its_last_frame(method: str) -> None:
    detector = create_detector(method, GRID)
    ((detection, read_ns),) = (
        (detection, frame.stamp_ns) for frame in lone() for detection in detector.update(frame)
    )
    assert detection.id == ID
    assert detection.zones == (ZONE,)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)
    assert detection.place.position_m == pytest.approx(1.2 * GRID.directions[ZONE], abs=2e-3)
    assert detection.start_ns == pytest.approx(2.0e9, abs=25e6)
    # The place holds at the mean time of the bright samples; a part of a packet may be enough.
    bits = (read_ns - 2.0e9) / 42e6
    assert bits == pytest.approx({'joint': 25.6, 'paper': 31.0}[method], abs=0.6)
    light = (1 - packet(ID)) * (np.arange(31) < bits)
    middle_bits = (light * (np.arange(31) + 0.5)).sum() / light.sum()
    middle_ns = 2.0e9 + (middle_bits if method == 'joint' else 15.5) * 42e6
    assert detection.stamp_ns == pytest.approx(middle_ns, abs=50e6)
    assert detection.end_ns == read_ns
    assert detection.bit_period_s == pytest.approx(0.042, rel=0.003)
    assert (detection.packets, detection.corrected_bits) == (1, 0)
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
def test_a_marker_that_never_pauses_is_read_packet_by_packet(method: str) -> None:
    starts = np.array([one.start_ns for one in run(repeating(14.0), method) if one.id == ID])
    assert len(starts) >= 8
    assert np.abs(np.diff(starts) / 1.302e9 - np.rint(np.diff(starts) / 1.302e9)).max() < 0.02


def test_a_marker_that_goes_on_is_remembered_however_many_others_are_read() -> None:
    """One that pauses begins anew with each packet; the other is read once a packet all along."""
    x, y, z = GRID.directions[0].tolist()
    scene = a_scene(start_s=0.0, packets=None)
    pausing = replace(scene.markers[0], id=OTHER_ID, position_m=(x, y, z), gap_bits=10)
    found = run(simulate(replace(scene, markers=(*scene.markers, pausing)), 130.0), 'joint')
    assert sum(one.id == OTHER_ID for one in found) > 64
    ends = np.array([one.end_ns for one in found if one.id == ID])
    assert 1e-9 * np.diff(ends).min() > 0.9 * PACKET_BITS * 0.042


def test_a_frame_that_was_overtaken_is_left_out() -> None:
    frames = list(repeating(14.0))
    late = list(frames)
    late[100], late[101], late[300], late[301] = (frames[i] for i in (101, 100, 301, 300))
    starts = [{round(one.start_ns / 42e6) for one in run(of, 'joint')} for of in (frames, late)]
    assert len(starts[0]) == 10
    assert starts[0] == starts[1]


@every_method
def test_frames_of_another_grid_are_refused(method: str) -> None:
    detector = create_detector(method, ZoneGrid(8, 8))
    for take in (detector.update_all, lambda frames: run(frames, detector)):
        with pytest.raises(ValueError, match='4x4 zones came to a detector for 8x8'):
            take(lone())


ROWS, ZONES = np.indices((len(repeating(5.0)), GRID.zones))
SAMPLES = {
    'some': np.random.default_rng(4).random(ROWS.shape) < 0.3,
    'strongest': ZONES == ZONE,
    'all': ZONES >= 0,
    'for a while': (ROWS >= 60) & (ROWS < 80),
}


@pytest.mark.filterwarnings('error')
@every_method
@pytest.mark.parametrize('field', ['distance', 'signal', 'ambient'])
@pytest.mark.parametrize('which', SAMPLES)
def test_impossible_values_are_erasures_without_place(method: str, field: str, which: str) -> None:
    recording = repeating(5.0)
    hit = SAMPLES[which]
    for value in (*IMPOSSIBLE[field], *STRANGE[field]):
        values = np.where(hit, np.float32(value), getattr(recording, field))
        spoilt = replace(recording, **{field: values})  # type: ignore[arg-type]
        detector = create_detector(method, GRID)
        read = detector.update_all(spoilt)
        is_impossible = value in IMPOSSIBLE[field]
        assert detector.counts.impossible == (np.count_nonzero(hit) if is_impossible else 0)
        if is_impossible and which == 'for a while':
            assert set(ids(read)) == {ID}
            assert max(d.start_ns for d in read) > recording.stamp_ns[80]
        elif is_impossible:
            assert bool(read) == (which == 'some')
        for detection in read:
            place = detection.place
            assert 0 < place.range_m < 1.2 * VL53L8CX.max_distance_m
            assert np.isfinite([*place.position_m, *place.covariance.ravel()]).all()
            assert place.range_stddev_m >= 0
            assert np.isfinite([detection.score, detection.snr_db, detection.likelihood]).all()


@every_method
def test_noise_of_all_bits_ends_nothing(method: str) -> None:
    rng = np.random.default_rng(5)
    noise = rng.integers(0, 256, (1500, 3, 64), dtype=np.uint8).view(np.float32)
    status = rng.integers(0, 256, (1500, 16), dtype=np.uint8)
    detector = create_detector(method, GRID)
    for number, (frame, values) in enumerate(zip(islice(cycle(lone()), 1500), noise, strict=True)):
        stamp_ns = int(rng.integers(0, 2**62)) if number % 50 == 0 else number * 10**7
        strange = dict(zip(('distance', 'signal', 'ambient'), values, strict=True))
        with np.errstate(all='ignore'):
            detector.update(replace(frame, stamp_ns=stamp_ns, status=status[number], **strange))
    assert detector.counts.impossible > 100
    assert ids(run(lone(), detector)) == [ID]


@every_method
def test_frames_of_one_stamp_and_blind_zones_do_no_harm(method: str) -> None:
    stuck = replace(lone(), stamp_ns=np.full_like(lone().stamp_ns, lone().stamp_ns[0]))
    twice = Recording.of([frame for frame in lone() for _ in range(2)])
    cases = [(stuck, []), (twice, [ID])]
    for blind, expected in ((np.arange(GRID.zones) != ZONE, [ID]), (np.full(GRID.zones, True), [])):
        dark: dict[str, Any] = {
            name: np.where(blind, value, getattr(lone(), name)).astype(getattr(lone(), name).dtype)
            for name, value in (('signal', 0), ('distance', np.nan), ('status', Status.NO_TARGET))
        }
        cases.append((replace(lone(), **dark), expected))
    for recording, expected in cases:
        assert ids(run(recording, method)) == expected
        assert ids(create_detector(method, GRID).update_all(recording)) == expected


@pytest.mark.parametrize(
    ('name', 'values', 'message'),
    [
        ('bit_period_s', (0.0, -0.042, np.inf, np.nan), 'bit_period of'),
        ('false_ids_per_hour', (0, -1, np.inf, np.nan), 'false_ids_per_hour of'),
        ('max_packets', (0, 9, -1), r'max_packets of \S+: it must be 1 to 8'),
        ('registered_ids', ([0, 4095], []), 'registered_ids holds 0|must be an integer'),
        ('registered_ids', ([ID, -1], [ID, 4096]), r'marker ID (-1|4096) is outside'),
    ],
)
@every_method
def test_bad_parameters(method: str, name: str, values: tuple[object, ...], message: str) -> None:
    for value in values:
        with pytest.raises(ValueError, match=message):
            create_detector(method, GRID, **{name: value})  # type: ignore[arg-type]


def test_an_impossible_request_is_refused() -> None:
    with pytest.raises(ValueError, match="unknown method 'magic'; there is joint, paper"):
        create_detector('magic', GRID)
    with pytest.raises(ValueError, match='likelihood_threshold of nan'):
        create_detector('paper', GRID, likelihood_threshold=float('nan'))


def test_candidates_are_those_of_the_latest_update() -> None:
    detector = create_detector('joint', GRID)
    assert isinstance(detector, LikelihoodDetector)
    read = []
    for frame in lone():
        detector.update(frame)
        read += [one.id for one in detector.candidates if one.reason is None]
    assert read == [ID]


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
    assert ids(run(stepping, method)) == []


# The paper's method


@pytest.mark.parametrize(('registered', 'read'), [(None, [ID, OTHER_ID]), ([OTHER_ID], [OTHER_ID])])
def test_two_at_once_are_read_or_counted(registered: list[int] | None, read: list[int]) -> None:
    detector = create_detector('paper', GRID, registered_ids=registered)
    scene = a_scene()
    (one,) = scene.markers
    # A little later and in another zone.
    other = replace(one, id=OTHER_ID, position_m=(0.39, -0.39, 1.2), start_s=2.3)
    detections = run(simulate(replace(scene, markers=(one, other))), detector)
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
    signal, distance, status = lone().signal.copy(), lone().distance.copy(), lone().status.copy()
    hit = np.random.default_rng(5).random(signal.shape) < 0.05
    signal[hit], distance[hit], status[hit] = 1000.0, 3.9, Status.SIGMA_TOO_HIGH
    garbage = replace(lone(), signal=signal, distance=distance, status=status)
    (detection,) = (detection for detection in run(garbage) if detection.id == ID)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)


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


def test_preamble_fit_is_the_papers_equations() -> None:
    rng = np.random.default_rng(11)
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


def test_silent_level_is_the_mean_before_a_marker_wakes() -> None:
    rng = np.random.default_rng(11)
    silent = 30.0 + 2.0 * rng.standard_normal((62, 4000))
    level = silent_level(silent)
    exact = np.isclose(level, silent.mean(axis=0))
    assert exact.mean() > 0.8
    # Where noise looks like bits the bright half of it is taken, 0.8 deviations too high.
    assert level[~exact].mean() - 30.0 == pytest.approx(0.8 * 2.0, abs=0.3)
    # While a marker transmits it is the bright one.
    shining = np.repeat(np.where(packet(np.arange(1, 4095)), 10.0, 30.0), 2, axis=-1).T
    assert silent_level(shining) == pytest.approx([30.0] * 4094)
    noisy = shining + 2.0 * rng.standard_normal(shining.shape)
    assert silent_level(noisy).mean() == pytest.approx(30.0, abs=0.1)
