# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What does not concern a packet changes nothing, nor does what was before a jump of time."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from evaluation.bench.recordings import record
from evaluation.bench.stresses import PLAIN, Stress
from retrolidar_ros.detector import Detection, Detector, create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.model import VL53L8CX, NoiseLaw

LAW = NoiseLaw()
ABNORMAL = Stress('20 % abnormal', abnormal=0.2)
PLAYED = (
    PLAIN,
    Stress('sways ±50 % in 2.6 s', sway=0.5, sway_s=2.6),
    Stress('second marker 25%', second=0.25),
    Stress('20 % lost', lost=0.2),
)
NATS = 0.01
"""What rounding may change of the evidence."""


def at_rows(recording: Recording, rows: NDArray[np.intp]) -> Recording:
    """Return those frames of a recording."""
    arrays = {name: one[rows] for name, one in vars(recording).items() if name != 'grid'}
    return Recording(grid=recording.grid, **arrays)


class Reading(NamedTuple):
    """What is read of a marker, in the order of zones."""

    zones: tuple[int, ...]
    id: int
    packets: int
    start_ns: int
    evidence: float


few = settings(max_examples=5)


class Case(NamedTuple):
    """Which recording is played."""

    stress: Stress
    signal: float
    repeated_s: float | None
    seed: int

    def recording(self) -> Recording:
        """Return frames of a marker in every zone, whose signals are whole sixteenths."""
        sent = record(
            self.stress,
            self.signal,
            np.random.default_rng(self.seed),
            USABLE_IDS,
            repeated_s=self.repeated_s,
        )
        # So that sums and products of the tests are exact.
        signal = np.rint(16 * sent.recording.signal) / 16
        return replace(sent.recording, signal=signal.astype(np.float32))


def cases(stresses: tuple[Stress, ...] = PLAYED) -> st.SearchStrategy[Case]:
    return st.builds(
        Case,
        stress=st.sampled_from(stresses),
        signal=st.sampled_from([15.0, 40.0, 150.0, 600.0]),
        repeated_s=st.sampled_from([None, 4.0]),
        seed=st.integers(0, 2**32 - 1),
    )


def new_detector(recording: Recording, noise: NoiseLaw = LAW) -> Detector:
    return create_detector('joint', recording.grid, sensor=replace(VL53L8CX, noise=noise))


def readings(detections: list[Detection]) -> list[Reading]:
    return sorted(Reading(d.zones, d.id, d.packets, d.start_ns, d.evidence) for d in detections)


def read(recording: Recording, noise: NoiseLaw = LAW) -> list[Reading]:
    return readings(new_detector(recording, noise).update_all(recording))


def assert_alike(found: list[Reading], expected: list[Reading]) -> None:
    """Compare all that is read, but for what rounding changes."""
    assert [one[:3] for one in found] == [one[:3] for one in expected]
    for one, other in zip(found, expected, strict=True):
        assert one.start_ns == pytest.approx(other.start_ns, abs=1e5)
        assert one.evidence == pytest.approx(other.evidence, abs=NATS)


@settings(few, max_examples=8)
@given(
    case=cases(),
    pedestal=st.sampled_from([0.0, 1.0, 8.0, 16.0]),
    gain=st.sampled_from([0.25, 0.5, 1.0, 4.0, 64.0]),
)
def test_a_pedestal_and_a_gain_change_nothing(case: Case, pedestal: float, gain: float) -> None:
    recording = case.recording()
    changed = replace(
        recording, signal=(recording.signal + np.float32(pedestal)) * np.float32(gain)
    )
    # The pedestal itself makes no noise here, so the law must not expect any of it.
    floor = (LAW.floor - LAW.slope * pedestal) * gain**2
    assert_alike(
        read(changed, NoiseLaw(floor, LAW.slope * gain, LAW.ambient * gain**2)), read(recording)
    )


@few
@given(case=cases(), shift_ns=st.integers(-(2**62), 2**62))
def test_a_shift_in_time_changes_nothing_else(case: Case, shift_ns: int) -> None:
    recording = case.recording()
    shifted = replace(recording, stamp_ns=recording.stamp_ns + shift_ns)
    moved = [one._replace(start_ns=one.start_ns - shift_ns) for one in read(shifted)]
    assert moved == read(recording)


@few
@given(case=cases(), seed=st.integers(0, 2**32 - 1))
def test_frames_that_come_again_change_nothing(case: Case, seed: int) -> None:
    recording = case.recording()
    times = np.random.default_rng(seed).choice([1, 1, 2, 3], len(recording))
    again = at_rows(recording, np.repeat(np.arange(len(recording)), times))
    assert read(again) == read(recording)


@few
@given(case=cases((*PLAYED, ABNORMAL)), cuts=st.lists(st.integers(0, 300), max_size=20))
def test_it_does_not_matter_where_a_recording_is_split(case: Case, cuts: list[int]) -> None:
    recording = case.recording()
    whole = new_detector(recording)
    expected = readings(whole.update_all(recording))
    parted = new_detector(recording)
    detections: list[Detection] = []
    for rows in np.split(np.arange(len(recording)), sorted(cuts)):
        detections += parted.update_all(at_rows(recording, rows))
    assert readings(detections) == expected
    assert parted.counts == whole.counts
    single = new_detector(recording)
    assert readings([one for frame in recording for one in single.update(frame)]) == expected


@few
@given(case=cases(), axis=st.sampled_from([1, 2]))
def test_a_mirrored_view_changes_nothing_else(case: Case, axis: int) -> None:
    recording, names = case.recording(), ('distance', 'signal', 'ambient', 'status')
    grid = recording.grid
    rng = np.random.default_rng(case.seed)
    # Four markers: where there is too much for one frame, what is left out depends on the order.
    walls = rng.choice(grid.zones, grid.zones - 4, replace=False)
    noise = np.rint(16 * np.abs(4 + 2.3 * rng.standard_normal((len(recording), len(walls))))) / 16
    recording.signal[:, walls] = noise
    order = np.flip(np.arange(grid.zones).reshape(1, grid.rows, grid.columns), axis).ravel()
    turned = replace(recording, **{name: getattr(recording, name)[:, order] for name in names})
    usual = new_detector(recording)
    expected = readings(usual.update_all(recording))
    assume(usual.counts.overloads == 0)
    mirrored = [one._replace(zones=tuple(order[[*one.zones]].tolist())) for one in read(turned)]
    assert_alike(sorted(mirrored), expected)


def two_markers(seed: int) -> Recording:
    """Return two markers in each zone, of which the clocks are fast, in noise, and lose frames."""
    fast = -0.01 * seed
    stress = Stress('two', second=0.6, lost=0.1, noise=2.0, sway=0.2, clock_error=fast)
    rng = np.random.default_rng(seed)
    recording = record(stress, 150.0, rng, USABLE_IDS, repeated_s=6.0).recording
    recording.ambient[:] = 3.0 * seed
    return recording


def played(detector: Detector, recording: Recording) -> list[list[Detection]]:
    """Return what every frame brings."""
    return [detector.update(frame) for frame in recording]


@pytest.mark.parametrize('jump_s', [-100.0, 1e4])
def test_a_jump_of_time_leaves_nothing(jump_s: float) -> None:
    before, recording = two_markers(0), two_markers(1)
    moved = replace(recording, stamp_ns=recording.stamp_ns + round(jump_s * 1e9))
    fresh, detector = played(new_detector(recording), moved), new_detector(recording)
    assert any(played(detector, before))
    assert repr(played(detector, moved)) == repr(fresh)
    assert sum(len(one) for one in fresh) > 20
