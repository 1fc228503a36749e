# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why less was read than could be: every remedy that is advised is one that reads."""

import re
from dataclasses import replace
from itertools import cycle
from typing import Any

import numpy as np
import pytest

from retrolidar_ros.detector.blinking_zones import blinking_zones
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.findings import Cause, Finding
from retrolidar_ros.detector.likelihood_detector import Candidate, Reason, Rejections
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene import Scene, Simulation, parse_scene
from retrolidar_ros.scene.description import Marker, Noise, Sensor, Surface
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.model import NoiseLaw

SENSOR = Sensor(jitter_s=0.001, noise=Noise(4.6, 0.22))
BITS_MS = (21, 30, 37, 38, 39, 50, 63, 84, 120)
PLACES = ((1.0, 1), (2.0, 2), (2.5, 4))  # range [m] and seed


def marker(range_m: float, **changes: Any) -> Marker:
    x, y, z = (range_m * SENSOR.grid.directions[10]).tolist()
    crystal = Response(0.0005, 0.0035)
    return Marker(**{'id': 2816, 'position_m': (x, y, z), 'response': crystal, **changes})


def seen(*markers: Marker, seed: int = 1, seconds: float = 20.0, wall: float = 4.0) -> Recording:
    walls = (Surface(4.0, wall),)
    scene = Scene(seed=seed, sensor=SENSOR, markers=markers, surfaces=walls)
    return Simulation(scene).run(seconds)


def explained(recording: Recording, **changes: Any) -> list[Finding]:
    decoding = Decoding({**defaults(), **changes})
    list(decoding.detect(recording))
    return decoding.explanation().findings()


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
    decoding = Decoding({**defaults(), 'bit_period': advised_s})
    read = list(decoding.detect(recording))
    assert {one.id for one in read} == {2816}
    assert sum(one.packets for one in read) * 31 * bit_ms * 1e-3 > 0.6 * 20


def test_one_packet_tells_its_bit_period_too() -> None:
    lone = seen(marker(1.2, bit_period_s=0.06, start_s=2.0, packets=1), seconds=6)
    (advice,) = explained(lone)
    assert advice.cause is Cause.BIT_PERIOD
    assert advice.values['found_s'] == pytest.approx(0.06, rel=0.01)


def causes(findings: list[Finding]) -> list[Cause]:
    return [one.cause for one in findings]


def test_a_silent_marker_may_be_asleep() -> None:
    (asleep,) = explained(seen(marker(1.0, start_s=1e3)))
    assert asleep.cause is Cause.STEADY
    assert 'zone 10 is by far the brightest, and steady' in str(asleep)
    assert 'wake it with light' in str(asleep)
    (nothing,) = explained(seen(wall=20.0))
    assert nothing.cause is Cause.NO_BLINKING
    assert 'asleep: wake it with light' in str(nothing)


def test_markers_that_hide_each_other_are_told_of_registered_ids() -> None:
    """Four of equal light, bit on bit: there is no telling which."""
    others = {2073: 0.042, 2107: 0.084, 2096: 0.126}
    (hidden,) = explained(
        seen(
            marker(1.0),
            *(marker(1.0, id=key, start_s=at) for key, at in others.items()),
            seconds=10.0,
        )
    )
    assert hidden.cause is Cause.NO_ID
    assert 'Several markers in the zone? Set registered_ids' in str(hidden)
    assert re.search(r'tried bits of 42.0, .* and \d+ more', str(hidden))
    two = seen(marker(1.0), marker(1.0, id=2073))
    assert explained(two, registered_ids=[2816, 2073]) == []


def test_a_marker_that_is_not_registered_is_named_beside_one_that_is() -> None:
    x, y, z = SENSOR.grid.directions[0].tolist()
    two = seen(marker(1.0), marker(1.0, id=2073, position_m=(x, y, z)))
    (unregistered,) = explained(two, registered_ids=[2816])
    assert unregistered.cause is Cause.UNREGISTERED
    assert unregistered.values['ids'] == '2073'


def test_a_faint_marker_is_told_of_max_packets() -> None:
    faint = seen(marker(3.1), seed=3)
    (advice,) = explained(faint, max_packets=1)
    assert advice.cause is Cause.MAX_PACKETS
    assert '2816 is read with max_packets 8' in str(advice)
    assert Cause.MAX_PACKETS not in causes(explained(faint))


def test_bits_of_one_frame_are_read_and_said_to_be_short() -> None:
    faint = seen(marker(3.3, bit_period_s=0.021), seconds=12)
    assert Cause.SHORT_BITS in causes(explained(faint, bit_period=0.021))
    too_fast = explained(seen(marker(1.0, bit_period_s=0.012)), bit_period=0.012)
    assert too_fast[0].cause is Cause.FRAME_RATE


def test_noise_is_not_told_from_the_marker_s_zone_alone() -> None:
    recording = seen(marker(1.0, bit_period_s=0.05))
    dark = replace(recording, status=recording.status.copy())
    dark.status[:, [zone for zone in range(16) if zone != 10]] = 255
    assert causes(explained(dark)) == [Cause.BIT_PERIOD]


def test_stamps_that_stand_still_are_told() -> None:
    frames = list(Simulation(load_scene('coffee')).run(4.0))
    decoding = Decoding(defaults())
    assert not list(decoding.detect(replace(one, stamp_ns=0) for one in frames))
    (found,) = decoding.explanation().findings()
    assert 'stand still' in str(found)


def recorded(period: str, bit: str, zones: str = '4x4') -> Recording:
    noise = {'floor': '4.6 (kcps/SPAD)^2', 'slope': '0.22 kcps/SPAD'}
    sensor = {'zones': zones, 'period': period, 'jitter': '1 ms', 'noise': noise}
    marker = {'id': 2816, 'position': ['0.13 m', '0.13 m', '1.2 m'], 'clock_error': '0.4 %'}
    wall = {'distance': '1.25 m', 'signal': '10 kcps/SPAD'}
    markers = [{**marker, 'bit_period': bit}]
    scene = {'seed': 5, 'sensor': sensor, 'markers': markers, 'surfaces': [wall]}
    return Simulation(parse_scene(scene)).run(20.0)


@pytest.mark.parametrize(
    ('period', 'bit', 'zones'),
    [('21 ms', '42 ms', '4x4'), ('33.3 ms', '100 ms', '4x4'), ('66.7 ms', '300 ms', '8x8')],
)
def test_an_unknown_bit_period_is_found(period: str, bit: str, zones: str) -> None:
    recording = recorded(period, bit, zones)
    best = blinking_zones(recording, NoiseLaw())[0]
    assert best.periods[0].bit_period_s == pytest.approx(float(bit.split()[0]) * 1.004e-3, rel=0.02)
    assert best.is_clocked


@pytest.mark.parametrize('steps_s', [[0.0], [0.0, 0.0, 0.0, 0.1], [0.02] * 100 + [-2.0], [-0.02]])
def test_stamps_that_do_not_go_on_have_no_bits(steps_s: list[float]) -> None:
    """As of a simulated clock that stands or ticks slowly, and of a replay that begins again."""
    recording = recorded('21 ms', '42 ms')
    steps_ns = np.rint(1e9 * np.resize(steps_s, len(recording) - 1)).astype(np.int64)
    odd = replace(recording, stamp_ns=10**12 + np.concatenate([[0], np.cumsum(steps_ns)]))
    with np.errstate(all='raise'):
        assert all(not zone.periods for zone in blinking_zones(odd, NoiseLaw()))


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
    (packet, *_) = Decoding(defaults()).detect(seen(marker(1.0), seconds=3.0))
    packet = replace(packet, zones=(read_in,), start_ns=start_ns, end_ns=start_ns + PACKET_NS)
    rejections = Rejections(SENSOR.grid)
    rejections.take([Candidate(7, zone, 1, Reason.EVIDENCE, 0, 0.042, 0.0, 0.0, 0.0)], [packet], 0)
    rejections.settle(PACKET_NS)
    assert not rejections.counts  # a packet that explains it may still be read
    rejections.settle(2 * PACKET_NS)
    assert rejections.counts[Reason.EVIDENCE.value] == rejected
