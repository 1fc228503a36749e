# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why less was read than could be, after a recording and while frames come; advice reads."""

import re
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from harness_frames import decoding

from retrolidar_ros.detector.blinking_zones import blinking_zones
from retrolidar_ros.detector.detection import Candidate, Reason
from retrolidar_ros.detector.explain import Explanation
from retrolidar_ros.detector.findings import Cause, Finding
from retrolidar_ros.detector.frame_monitor import FrameMonitor
from retrolidar_ros.detector.likelihood_detector import Rejections
from retrolidar_ros.detector.parameters import DetectorSettings, defaults
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Sensor, Surface, load_scene
from retrolidar_ros.scene.reference import NOISE, RESPONSE
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.model import NoiseLaw

SENSOR = Sensor(jitter_s=0.001, noise=NOISE)
BITS_MS = (21, 30, 37, 38, 39, 50, 63, 84, 120)
PLACES = ((1.0, 1), (2.0, 2), (2.5, 4))  # range [m] and seed


def marker(range_m: float = 1.0, **changes: Any) -> Marker:
    x, y, z = (range_m * SENSOR.grid.directions[10]).tolist()
    return Marker(**{'id': 2816, 'position_m': (x, y, z), 'response': RESPONSE, **changes})


def seen(
    *markers: Marker, seed: int = 1, seconds: float = 20.0, wall: float = 4.0, **sensor: Any
) -> Recording:
    walls = (Surface(4.0, wall),)
    scene = Scene(seed=seed, sensor=replace(SENSOR, **sensor), markers=markers, surfaces=walls)
    return Simulation(scene).run(seconds)


def explained(recording: Recording, **changes: Any) -> list[Finding]:
    judging = decoding(**changes)
    list(judging.detect(recording))
    return judging.explanation().findings()


@pytest.mark.parametrize(
    ('bit_ms', 'range_m', 'seed'),
    [
        *((42, *place) for place in PLACES),
        *((bit_ms, *place) for bit_ms, place in zip(BITS_MS, cycle(PLACES), strict=False)),
    ],
)
def test_the_bit_period_advised_is_the_true_one(bit_ms: float, range_m: float, seed: int) -> None:
    """Also where a clock shows an alias, as of bits shorter than two frames, or none, as of one."""
    start_s = 0.007 * seed
    recording = seen(marker(range_m, bit_period_s=bit_ms * 1e-3, start_s=start_s), seed=seed)
    findings = explained(recording)
    if bit_ms == 42:
        assert findings == []
        return
    advice = [one for one in findings if one.cause is Cause.BIT_PERIOD]
    assert [one.values['ids'] for one in advice] == ['2816']
    assert advice[0].values['found_s'] == pytest.approx(bit_ms * 1e-3, rel=0.01)
    advised_s = float(str(advice[0]).split()[-1])
    read = list(decoding(bit_period=advised_s).detect(recording))
    assert {one.id for one in read} == {2816}
    assert sum(one.packets for one in read) * 31 * bit_ms * 1e-3 > 0.6 * 20


def test_a_near_trial_that_reads_advises_no_bit_period_that_is_set(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A detector for bits of 43 ms measures 42 ms, which is the parameter."""
    monkeypatch.setattr(Explanation, '_likely', lambda *_: [0.043])
    recording, settings = seen(marker()), DetectorSettings(defaults())
    explanation = Explanation(recording, settings)
    *_, last = explanation.why(explanation.zones[0])
    assert last is None
    # What blinks is not said to be steady.
    (finding,) = Explanation(recording, settings).findings()
    assert finding.cause is Cause.FEW_READ
    assert finding.values == {'ids': '2816', 'read': 0, 'sent': 15}
    assert 'ID 2816 was read in 0 packets of 15' in str(finding)


def test_one_packet_tells_its_bit_period_too() -> None:
    lone = seen(marker(1.2, bit_period_s=0.06, start_s=2.0, packets=1), seconds=6)
    (advice,) = explained(lone)
    assert advice.cause is Cause.BIT_PERIOD
    assert advice.values['found_s'] == pytest.approx(0.06, rel=0.01)


def causes(recording: Recording, **changes: Any) -> list[Cause]:
    return [one.cause for one in explained(recording, **changes)]


def test_a_silent_marker_may_be_asleep() -> None:
    (asleep,) = explained(seen(marker(start_s=1e3)))
    assert (asleep.cause, asleep.values) == (Cause.STEADY, {'zone': 10})
    assert 'zone 10 is by far the brightest, and steady' in str(asleep)
    assert 'wake it with light' in str(asleep)
    (nothing,) = explained(seen(wall=20.0))
    assert nothing.cause is Cause.NO_BLINKING
    assert 'asleep: wake it with light' in str(nothing)


def test_markers_that_hide_each_other_are_told_of_registered_ids() -> None:
    """Four of equal light, bit on bit: there is no telling which."""
    four = [marker(id=key, start_s=0.042 * n) for n, key in enumerate((2816, 2073, 2107, 2096))]
    (hidden,) = explained(seen(*four, seconds=10.0))
    assert hidden.cause is Cause.NO_ID
    assert 'Several markers in the zone? Set registered_ids' in str(hidden)
    assert re.fullmatch(r'42\.0, .* and \d+ more', hidden.values['tried'])
    two = seen(marker(), marker(id=2073))
    assert explained(two, registered_ids=[2816, 2073]) == []


def test_a_marker_that_is_not_registered_is_named_beside_one_that_is() -> None:
    x, y, z = SENSOR.grid.directions[0].tolist()
    two = seen(marker(), marker(id=2073, position_m=(x, y, z)))
    (unregistered,) = explained(two, registered_ids=[2816])
    assert (unregistered.cause, unregistered.values) == (Cause.UNREGISTERED, {'ids': '2073'})


def test_a_faint_marker_is_told_of_max_packets() -> None:
    faint = seen(marker(3.1), seed=3)
    (advice,) = explained(faint, max_packets=1)
    assert (advice.cause, advice.values['ids']) == (Cause.MAX_PACKETS, '2816')
    assert '2816 is read with max_packets 8' in str(advice)
    assert Cause.MAX_PACKETS not in causes(faint)


def test_bits_of_one_frame_are_read_and_said_to_be_short() -> None:
    faint = seen(marker(3.3, bit_period_s=0.021), seconds=12)
    assert Cause.SHORT_BITS in causes(faint, bit_period=0.021)
    too_fast = seen(marker(bit_period_s=0.012))
    assert causes(too_fast, bit_period=0.012)[0] is Cause.FRAME_RATE


def test_a_recording_without_noise_is_told_of_once() -> None:
    assert causes(seen(noise=None)) == [Cause.NO_BLINKING, Cause.NO_NOISE]


def test_noise_is_not_told_from_the_marker_s_zone_alone() -> None:
    recording = seen(marker(bit_period_s=0.05))
    dark = replace(recording, status=recording.status.copy())
    dark.status[:, [zone for zone in range(16) if zone != 10]] = 255
    assert causes(dark) == [Cause.BIT_PERIOD]


def test_stamps_that_stand_still_are_told() -> None:
    judging = decoding()
    assert not list(judging.detect(replace(one, stamp_ns=0) for one in seen(marker(), seconds=4)))
    (found,) = judging.explanation().findings()
    assert found.cause is Cause.STAMPS
    assert 'stand still' in str(found)


@pytest.mark.parametrize(
    ('period_s', 'bit_s', 'side'), [(0.021, 0.042, 4), (0.0333, 0.1, 4), (0.0667, 0.3, 8)]
)
def test_an_unknown_bit_period_is_found(period_s: float, bit_s: float, side: int) -> None:
    fast = marker(1.2, bit_period_s=bit_s, clock_error=0.004)
    recording = seen(fast, period_s=period_s, grid=ZoneGrid(side, side))
    best = blinking_zones(recording, NoiseLaw())[0]
    assert best.periods[0].bit_period_s == pytest.approx(1.004 * bit_s, rel=0.02)
    assert best.is_clocked


@pytest.mark.parametrize('steps_s', [[0.0], [0.0, 0.0, 0.0, 0.1], [0.02] * 100 + [-2.0], [-0.02]])
def test_stamps_that_do_not_go_on_have_no_bits(steps_s: list[float]) -> None:
    """As of a simulated clock that stands or ticks slowly, and of a replay that begins again."""
    recording = seen(marker(1.2))
    steps_ns = np.rint(1e9 * np.resize(steps_s, len(recording) - 1)).astype(np.int64)
    odd = replace(recording, stamp_ns=10**12 + np.concatenate([[0], np.cumsum(steps_ns)]))
    with np.errstate(all='raise'):
        (zone,) = blinking_zones(odd, NoiseLaw())
    assert zone.periods == ()


PACKET_NS = round(31 * 42e6)


@pytest.mark.parametrize(
    ('zone', 'read_in', 'begins', 'rejected'),
    [
        (5, 5, 0.0, 0),
        (5, 6, 0.5, 0),  # beside it, half a packet later
        (5, 7, 0.0, 1),
        (5, 5, 1.5, 1),
        (5, 5, -1.5, 1),
        (16, 15, 0.0, 0),  # a sum of zones
    ],
)
def test_a_candidate_is_rejected_once_no_packet_can_explain_it_any_more(
    zone: int, read_in: int, begins: float, rejected: int
) -> None:
    start_ns = round(begins * PACKET_NS)
    (packet, *_) = decoding().detect(seen(marker(), seconds=3.0))
    packet = replace(packet, zones=(read_in,), start_ns=start_ns, end_ns=start_ns + PACKET_NS)
    rejections = Rejections(SENSOR.grid)
    rejections.take([Candidate(7, zone, 1, Reason.EVIDENCE, 0, 0.042, 0.0, 0.0, 0.0)], [packet], 0)
    rejections.settle(PACKET_NS)
    assert not rejections.counts  # a packet that explains it may still be read
    rejections.settle(2 * PACKET_NS)
    assert rejections.counts[Reason.EVIDENCE.value] == rejected


def frames_of(bit_s: float = 0.042, seconds: float = 20.0) -> list[Frame]:
    return list(seen(marker(1.5, bit_period_s=bit_s), seconds=seconds))


def said_of(frames: list[Frame], **changes: Any) -> list[str]:
    """Return what is said once a second, while a detector reads what it can."""
    settings = DetectorSettings({**defaults(), **changes})
    detector = settings.detector(frames[0].grid)
    monitor = FrameMonitor(frames[0].grid)
    found = []
    for number, frame in enumerate(frames):
        if monitor.take(frame):
            monitor.read(detector.update(frame))
        if number % 48 == 47:
            found.append(str(monitor.unread(settings) or ''))
    return found


@pytest.mark.parametrize(
    ('bit_s', 'set_s'), [(0.046, 0.042), (0.055, 0.042), (0.040, 0.042), (0.042, 0.063)]
)
def test_one_bit_period_is_advised_and_it_reads(bit_s: float, set_s: float) -> None:
    """Bits of 42 ms and more have a clock; of 40 ms, alias 44.2, two bit periods are tried."""
    every = said_of(frames_of(bit_s), bit_period=set_s)
    # Longer ones are told within four seconds.
    assert any(every[:4]) or bit_s <= 0.042
    said = [one for one in every if one]
    assert len(said) > 5
    assert len(set(said)) == 1
    advised_s = float(said[0].split()[-1])
    assert advised_s == pytest.approx(bit_s, rel=0.006)
    assert 'ID 2816 is read with' in said[0]


def test_nothing_is_said_of_what_is_read_is_unregistered_or_does_not_blink() -> None:
    frames = frames_of()
    assert not any(said_of(frames))
    assert not any(said_of(list(Simulation(load_scene('coffee')).run(20.0))))
    assert not any(said_of(frames_of(0.046), registered_ids=[7]))
    rng = np.random.default_rng(1)
    noise = (60 + 4.2 * rng.standard_normal((len(frames), 16))).astype(np.float32)
    noisy = [replace(one, signal=signal) for one, signal in zip(frames, noise, strict=True)]
    assert not any(said_of(noisy))
    # Nor of a sensor that was stopped for a while, or its cable was out.
    for number in range(200, 800, 60):
        later = [replace(frame, stamp_ns=frame.stamp_ns + 4 * 10**9) for frame in frames[number:]]
        assert not any(said_of([*frames[:number], *later]))


def test_an_unknown_code_is_missed_only_where_it_may_come() -> None:
    """A regular light that changes at every bit blinks by the right clock, and means nothing."""
    frames = frames_of()
    rng = np.random.default_rng(2)
    bits = rng.integers(0, 2, 2000)
    light = [60 + 40 * bits[int(frame.stamp_ns / 42e6)] for frame in frames]
    strange = [
        replace(frame, signal=np.where(np.arange(16) < 8, level, frame.signal).astype(np.float32))
        for frame, level in zip(frames, light, strict=True)
    ]
    said = said_of(strange)[-5:]
    # A word of random bits may be an ID now and then.
    assert sum('no ID fits (tried bits of 42.0' in one for one in said) >= 4, said
    assert not any(said_of(strange, registered_ids=[7]))


def test_gaps_repeats_steps_back_and_what_was_not_sent_are_counted() -> None:
    frames = frames_of(seconds=2.0)
    monitor, of_sender = FrameMonitor(SENSOR.grid), FrameMonitor(SENSOR.grid)
    taken = [frames[index] for index in (0, 1, 1, 5, 2, 3)]
    assert [monitor.take(frame) for frame in taken] == [True, True, False, True, False, False]
    assert (monitor.frames, monitor.lost, monitor.repeated, monitor.reversed) == (6, 3, 1, 2)
    for index, max_lost in ((0, 5), (1, 0), (5, 0), (9, 1), (10, 7)):
        of_sender.take(frames[index], max_lost)
    assert (of_sender.lost, of_sender.unsent) == (1, 5)


def test_frames_from_before_time_was_set_back_are_forgotten() -> None:
    frames = frames_of(seconds=2.0)
    monitor = FrameMonitor(SENSOR.grid)
    for frame in [*frames[50:], *frames[:10]]:
        assert monitor.take(frame)
    assert list(monitor.newest) == frames[:10]


def test_the_rate_is_found_from_what_came_however_much_is_lost() -> None:
    kept = np.random.default_rng(3).random(381) < 0.4
    monitor, late = FrameMonitor(SENSOR.grid), FrameMonitor(SENSOR.grid)
    for number, frame in enumerate(seen(seconds=8.0, jitter_s=0.0)):
        if kept[number]:
            monitor.take(frame)
        late.take(replace(frame, stamp_ns=10**9 + number))
    assert monitor.rate(0.042) is None
    assert monitor.rate(0.021) is None
    assert 'a frame comes every 2' in str(monitor.rate(0.015))
    assert '14.3 frames, and not one to eight' in str(monitor.rate(0.3))
    assert late.rate(0.042) is None  # they came all at once
