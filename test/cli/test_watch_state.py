# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What `retrolidar watch` knows of a port, and the picture that it draws of that."""

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from harness_frames import make_frame

from retrolidar_ros.cli.watch import Watch
from retrolidar_ros.cli.watch_view import (
    BRIGHT,
    DARK,
    ERASED,
    ROWS,
    LastReading,
    Snapshot,
    fitted,
    line,
    screen,
)
from retrolidar_ros.detector.blinking_zones import NewestBits, modulation_db, newest_bits
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.code import BIT_PERIOD_S, packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Sensor, Surface
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.model import NoiseLaw, Status
from retrolidar_ros.sensor.serial_source import PROTOCOLS, SerialSource

ID, ZONE = 2073, 10
SCENE = Scene(
    seed=4,
    sensor=Sensor(noise=Noise(4.6, 0.22)),
    markers=(Marker(id=ID, position_m=(0.1, 0.1, 1), name='m'),),
    surfaces=(Surface(2, 40),),
)


def frame(grid: ZoneGrid, sequence: int = 0) -> Frame:
    """Return a frame with another signal in every zone, and no target in the last."""
    one = make_frame(grid.rows, sequence, stamp_ns=21_000_000 * sequence)
    one.distance[-1], one.status[-1] = np.nan, Status.NO_TARGET
    return one


def seen(scene: Scene, frames: int) -> Recording:
    return Recording.of(list(Simulation(scene).advance(frames))[-68:])


def open_watch(bit_period_s: float = BIT_PERIOD_S, zone: int | None = None) -> Watch:
    """Return what is known of a port that is open, so far nothing."""
    source = SerialSource('port', 460800, PROTOCOLS['retrolidar'](time.monotonic_ns))
    source.problem = ''
    return Watch(source, zone, {**defaults(), 'bit_period': bit_period_s})


def give(state: Watch, frames: Sequence[Frame]) -> None:
    """Let frames come when they were exposed, the last of them now."""
    begin_ns = time.monotonic_ns() - frames[-1].sensor_time_us * 1000
    for one in frames:
        state.take([one], begin_ns + one.sensor_time_us * 1000)


def watch_of(frames: list[Frame], zone: int | None = None) -> Watch:
    """Return what is known after frames that come when they were exposed."""
    state = open_watch(zone=zone)
    give(state, frames)
    return state


@pytest.mark.parametrize('frames', range(100, 170, 23))
def test_the_newest_bits_are_the_packet_from_some_bit_on(frames: int) -> None:
    bits = newest_bits(seen(SCENE, frames), ZONE, BIT_PERIOD_S)
    assert bits is not None
    sent = packet(ID) == 1
    assert any((np.roll(sent, -first) == bits.hard).all() for first in range(31))
    # The marker's light, at 1 m and beside the axis, and none of it; with the wall's behind it.
    assert 200 < bits.bright < 400
    assert bits.dark < 60


def test_lost_bits_are_unknown() -> None:
    frames = list(Simulation(SCENE).advance(140))[-72:]
    bits = newest_bits(Recording.of(frames[:30] + frames[36:]), ZONE, BIT_PERIOD_S)
    assert bits is not None
    assert 2 <= np.count_nonzero(bits.erased) <= 4
    dark = [replace(frame(ZoneGrid(), n), signal=np.zeros(16, np.float32)) for n in range(72)]
    assert newest_bits(Recording.of(dark), 3, BIT_PERIOD_S) is None


def test_blinking_is_the_marker_s_and_noise_is_none() -> None:
    blinking = modulation_db(seen(SCENE, 140), NoiseLaw())
    amplitude, noise = 290.0, NoiseLaw().variance(np.asarray(185.0))
    assert blinking[ZONE] == pytest.approx(10 * np.log10(amplitude**2 / noise), abs=2)
    assert np.delete(blinking, ZONE).max() < 3
    known = watch_of(list(Simulation(replace(SCENE, markers=())).advance(100))).snapshot()
    assert known.zone is None
    assert 'no zone blinks' in line(known)
    assert 'no zone blinks' in screen(known)


def test_the_zone_that_blinks_most_is_chosen_and_read() -> None:
    frames = list(Simulation(SCENE).advance(200))
    known = watch_of(frames[:20] + frames[23:]).snapshot()
    assert (known.zone, known.trouble) == (ZONE, '')
    assert (known.frames, known.lost, known.damaged) == (197, 3, 0)
    assert known.bits is not None
    (reading,) = known.readings
    assert (reading.detection.id, reading.detection.zones[0]) == (ID, ZONE)
    assert 0 <= reading.age_s < 3
    assert f'zone {ZONE}' in line(known)
    assert f'last ID {ID} at 1.0' in line(known)


def test_a_zone_stays_chosen_until_another_blinks_far_more() -> None:
    def blinking(number: int, other: float) -> Frame:
        one = frame(ZoneGrid(), number)
        dark = number // 2 % 2
        one.signal[[2, 5]] = (10.0, 10.0) if dark else (110.0, other)
        return one

    state = open_watch()
    for first, other, chosen in ((0, 60.0, 2), (80, 130.0, 2), (160, 400.0, 5)):
        give(state, [blinking(number, other) for number in range(first, first + 80)])
        assert state.snapshot().zone == chosen


def test_trouble_is_reported_with_what_may_be_the_reason() -> None:
    reader = PROTOCOLS['retrolidar'](time.monotonic_ns)
    source = SerialSource('port', 460800, reader)
    state = Watch(source, None, defaults())
    assert state.snapshot().trouble == 'port has not been opened yet; retrying'
    source.problem = ''  # as while it is open
    begin_ns = time.monotonic_ns()
    state.take([frame(ZoneGrid())], begin_ns)
    assert state.snapshot().trouble == ''
    state.take([frame(ZoneGrid(), 1)], begin_ns - 3_000_000_000)
    nothing = 'nothing comes: is the sensor started, and the baud rate right? (3 s)'
    assert state.snapshot().trouble == nothing
    reader.feed(b'\x0012 | 345 : 6\r\n\0')
    known = state.snapshot()
    assert known.damaged == 1
    assert 'damaged packets: another baud rate or protocol?' in known.trouble
    unsuited = open_watch(bit_period_s=0.015)
    give(unsuited, [frame(ZoneGrid(), number) for number in range(40)])
    assert 'but bit_period is 15.0 ms: 0.7 frames' in unsuited.snapshot().trouble


def test_another_grid_begins_anew_and_needs_a_zone_of_its_own() -> None:
    small = [frame(ZoneGrid(), number) for number in range(40)]
    large = [frame(ZoneGrid(8, 8), number) for number in range(40, 80)]
    known = watch_of(small + large).snapshot()
    assert known.frame is not None
    assert known.frame.grid == ZoneGrid(8, 8)
    assert known.modulation_db.shape == (64,)
    read = list(Simulation(SCENE).advance(150))
    assert watch_of(read).snapshot().readings
    other = [frame(ZoneGrid(8, 8), number) for number in range(150, 190)]
    assert not watch_of(read + other).snapshot().readings
    assert watch_of(small, zone=3).snapshot().zone == 3
    assert watch_of(large, zone=16).snapshot().zone == 16
    with pytest.raises(ValueError, match=r'--zone 16: the sensor has 4x4 zones, 0 to 15'):
        watch_of(small, zone=16)


def snapshot(grid: ZoneGrid, zone: int | None = None) -> Snapshot:
    blinking = np.full(grid.zones, -np.inf)
    if zone is not None:
        blinking[zone] = 40.0
    return Snapshot('port', '', 47.6, 100, 0, 0, frame(grid), blinking, zone)


@pytest.mark.parametrize(('grid', 'columns'), [(ZoneGrid(), 80), (ZoneGrid(8, 8), 100)])
def test_zones_lie_as_seen_from_the_sensor(grid: ZoneGrid, columns: int) -> None:
    lines = screen(snapshot(grid))
    assert max(map(len, lines)) <= columns
    cells = [text.split('|') for text in lines if text.count('|') == grid.columns - 1]
    tops, bottoms = cells[::2], cells[1::2]
    numbers = [[int(cell.split()[0]) for cell in row] for row in tops]
    assert numbers == np.arange(grid.zones).reshape(grid.rows, grid.columns).tolist()
    signals = [[float(cell.split()[0]) for cell in row] for row in bottoms]
    assert signals == (np.array(numbers) + 10.0).tolist()
    assert bottoms[0][1].split()[1] in ('0.510', '0.51')
    assert tops[-1][-1].split()[-1] == '255'
    assert bottoms[-1][-1].split()[1] == '-'
    # Everything lies in columns.
    assert len({len(text) for text in lines if text.count('|') == grid.columns - 1}) == 1


def test_bits_are_drawn_dark() -> None:
    sent = np.roll(packet(ID), -5)  # a packet that is seen from its sixth bit on
    bits = NewestBits(np.where(sent == 1, 10.0, 110.0), 10.0, 110.0)
    bits.signal[30] = np.nan
    lines = screen(replace(snapshot(ZoneGrid(), 9), bits=bits))
    (drawn,) = (text for text in lines if text.startswith('  bits'))
    dark = ''.join(DARK if bit else BRIGHT for bit in sent[:30])
    assert drawn.split()[1] == dark + ERASED


def test_a_picture_that_is_cut_says_what_size_it_needs() -> None:
    (reading,) = watch_of(list(Simulation(SCENE).advance(200))).snapshot().readings
    readings = [LastReading(reading.detection, 1.0, 1)] * 3
    lines = screen(replace(snapshot(ZoneGrid(), 9), readings=readings))
    assert len(lines) == ROWS
    assert fitted(lines, 80, 21) == lines
    assert fitted(lines, 80, 19) == [*lines[:18], 'enlarge the terminal to 80x21']
    narrow = fitted(lines, 60, 21)
    assert narrow[:-1] == [text[:60] for text in lines[:-1]]
    assert narrow[-1] == 'enlarge the terminal to 80x21'
    assert fitted(lines, 7, 1) == ['enlarge']
    troubled = screen(replace(snapshot(ZoneGrid(), 9), trouble='a ' * 79, readings=readings))
    assert fitted(troubled, 80, 21)[-1] == 'enlarge the terminal to 80x22'
    large = screen(snapshot(ZoneGrid(8, 8)))
    assert fitted(large, 80, 40)[-1] == f'enlarge the terminal to 95x{len(large)}'
