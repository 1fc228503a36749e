# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import io
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fcntl import ioctl
from pathlib import Path
from struct import pack
from termios import TIOCSWINSZ
from threading import Event, Thread

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from st_board import Board, Zone

from retrolidar_ros.cli.arguments import detector_values
from retrolidar_ros.cli.main import main, parser
from retrolidar_ros.cli.watch import watch
from retrolidar_ros.cli.watch_state import Watch
from retrolidar_ros.cli.watch_view import (
    ASCII,
    BLOCKS,
    COLUMNS,
    ROWS,
    LastReading,
    Snapshot,
    Symbols,
    fitted,
    line,
    screen,
)
from retrolidar_ros.detector.blinking import BitReader, NewestBits, Samples, modulation_db
from retrolidar_ros.detector.budget import Demands
from retrolidar_ros.detector.likelihood_detector import Candidate
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.detector.reason import Reason
from retrolidar_ros.detector.settings import defaults
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Sensor, Surface
from retrolidar_ros.sensor.frame import Frame, Recording, Status, ZoneGrid
from retrolidar_ros.sensor.frame_rate import missing_frames, rate_mismatch
from retrolidar_ros.sensor.protocols import PROTOCOLS
from retrolidar_ros.sensor.serial_source import SerialSource
from retrolidar_ros.settings.resources import shared_file

Output = pytest.CaptureFixture[str]

ID, ZONE = 2073, 10
SCENE = Scene(
    seed=4,
    sensor=Sensor(noise=Noise(4.6, 0.22)),
    markers=(Marker(id=ID, position_m=(0.1, 0.1, 1), name='m'),),
    surfaces=(Surface(2, 40),),
)
COFFEE = {'2073', '2096', '2107'}
COMMAND = [sys.executable, '-m', 'retrolidar_ros.cli.main']
PATIENCE_S = 60.0


def frame(grid: ZoneGrid, sequence: int = 0) -> Frame:
    """Return a frame with another signal in every zone, and no target in the last."""
    zones = np.arange(grid.zones)
    distance = (1 + zones / 100).astype(np.float32)
    distance[-1] = np.nan
    status = np.full(grid.zones, Status.VALID, dtype=np.uint8)
    status[-1] = Status.NO_TARGET
    return Frame(
        stamp_ns=21_000_000 * sequence,
        sequence=sequence,
        sensor_time_us=21_000 * sequence,
        grid=grid,
        distance=distance,
        signal=(zones + 0.5).astype(np.float32),
        ambient=np.zeros(grid.zones, dtype=np.float32),
        status=status,
    )


def snapshot(grid: ZoneGrid, zone: int | None = None) -> Snapshot:
    blinking = np.full(grid.zones, -np.inf)
    if zone is not None:
        blinking[zone] = 40.0
    return Snapshot('port', '', 47.6, 100, 0, 0, frame(grid), blinking, zone)


def seen(scene: Scene, frames: int) -> Samples:
    return Samples.of(Recording.of(list(Simulation(scene).advance(frames))[-68:]))


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


def known_readings() -> Sequence[LastReading]:
    return watch_of(list(Simulation(SCENE).advance(200))).snapshot().readings


# Bits


@pytest.mark.parametrize('frames', range(100, 170, 7))
def test_the_newest_bits_are_the_packet_from_some_bit_on(frames: int) -> None:
    bits = BitReader(BIT_PERIOD_S).read(seen(SCENE, frames), ZONE, NoiseLaw())
    assert bits is not None
    assert bits.hard.tolist() == (np.roll(packet(ID), -bits.first) == 1).tolist()
    assert (bits.id, bits.differing) == (ID, 0)
    assert bits.correlation > 0.95
    # The marker's light, at 1 m and beside the axis, and none of it; with the wall's behind it.
    assert 200 < bits.bright < 400
    assert bits.dark < 60


def test_lost_bits_are_unknown_and_do_not_count_as_wrong() -> None:
    frames = list(Simulation(SCENE).advance(140))[-72:]
    samples = Samples.of(Recording.of(frames[:30] + frames[36:]))
    bits = BitReader(BIT_PERIOD_S).read(samples, ZONE, NoiseLaw())
    assert bits is not None
    assert 2 <= np.count_nonzero(bits.erased) <= 4
    assert (bits.id, bits.differing) == (ID, 0)
    dark = [replace(frame(ZoneGrid(), n), signal=np.zeros(16, np.float32)) for n in range(72)]
    samples = Samples.of(Recording.of(dark))
    assert BitReader(BIT_PERIOD_S).read(samples, 3, NoiseLaw()) is None


def test_blinking_is_the_marker_s_and_noise_is_none() -> None:
    blinking = modulation_db(seen(SCENE, 140), NoiseLaw())
    amplitude, noise = 290.0, NoiseLaw().variance(np.asarray(185.0))
    assert blinking[ZONE] == pytest.approx(10 * np.log10(amplitude**2 / noise), abs=2)
    assert np.delete(blinking, ZONE).max() < 3
    known = watch_of(list(Simulation(replace(SCENE, markers=())).advance(100))).snapshot()
    assert known.zone is None
    assert 'no zone blinks' in line(known)
    assert 'no zone blinks' in screen(known, BLOCKS)


# What is known


def test_the_zone_that_blinks_most_is_chosen_and_read() -> None:
    state = watch_of(list(Simulation(SCENE).advance(200)))
    known = state.snapshot()
    assert (known.zone, known.trouble) == (ZONE, '')
    assert (known.frames, known.lost, known.damaged) == (200, 0, 0)
    assert known.bits is not None
    assert known.bits.id == ID
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


def test_trouble_is_told_and_what_may_be_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    reader = PROTOCOLS['retrolidar'](time.monotonic_ns)
    source = SerialSource('port', 460800, reader)
    state = Watch(source, None, defaults())
    assert state.snapshot().trouble == 'port has not been opened yet; retrying'
    source.problem = ''  # as while it is open
    begin_ns = time.monotonic_ns()
    state.take([frame(ZoneGrid())], begin_ns)
    assert state.snapshot().trouble == ''
    state.take([frame(ZoneGrid(), 1)], begin_ns - 3_000_000_000)
    assert state.snapshot().trouble.startswith('no frames come for 3 s; the sensor is silent')
    source.received += 14
    assert state.snapshot().trouble.endswith(
        'bytes come, but no frame ends: another --baud, --protocol retrolidar or '
        '--protocol st_example?'
    )
    reader.counts.withheld += 1
    assert 'no signal, which the sensor has been asked for' in state.snapshot().trouble
    reader.counts.withheld -= 1
    reader.feed(b'\x0012 | 345 : 6\r\n\0')
    known = state.snapshot()
    assert known.damaged == 1
    assert 'no frame of this protocol, or of another --baud' in known.trouble
    unsuited = open_watch(bit_period_s=0.03)
    give(unsuited, [frame(ZoneGrid(), number) for number in range(40)])
    assert unsuited.snapshot().trouble == (
        'a frame comes every 21.0 ms, but bit_period is 30.0 ms: 1.4 frames, and not two to eight: '
        'set --bit-period to how long the markers hold a bit [s]'
    )
    # What the reader tells is shown for a while.
    state, now_ns = open_watch(), time.monotonic_ns()
    state.take([frame(ZoneGrid())], now_ns, 'slow text')
    assert state.snapshot().trouble == 'slow text'
    monkeypatch.setattr(time, 'monotonic_ns', lambda: now_ns + 31_000_000_000)
    state.take([frame(ZoneGrid(), 1)], now_ns + 31_000_000_000)
    assert state.snapshot().trouble == ''


def test_a_still_scene_before_st_s_example_does_not_blink() -> None:
    shown = io.StringIO()
    stop = Event()
    with Board([Zone(700, signal_kcps=250)] * 16) as board:
        printing = Thread(target=board.run, args=(stop, 0.05))
        printing.start()
        try:
            frames = watch(
                board.path,
                shown,
                baud=460800,
                protocol='st_example',
                zone=None,
                values={**defaults(), 'bit_period': 0.1},
                duration_s=3.0,
            )
        finally:
            stop.set()
            printing.join()
    assert frames > 10
    last = shown.getvalue().splitlines()[-1]
    assert "ST's example sends a frame every" in last
    assert last.endswith('no zone blinks')


def test_another_grid_begins_anew_and_needs_a_zone_of_its_own() -> None:
    small = [frame(ZoneGrid(), number) for number in range(40)]
    large = [frame(ZoneGrid(8, 8), number) for number in range(40, 80)]
    known = watch_of(small + large).snapshot()
    assert known.frame is not None
    assert known.frame.grid == ZoneGrid(8, 8)
    assert known.modulation_db.shape == (64,)
    assert watch_of(small, zone=3).snapshot().zone == 3
    assert watch_of(large, zone=16).snapshot().zone == 16
    with pytest.raises(ValueError, match=r'--zone 16: the sensor has 4x4 zones, 0 to 15'):
        watch_of(small, zone=16)


def test_missing_frames_are_counted_and_a_rate_that_does_not_suit_is_told() -> None:
    frames = list(Simulation(SCENE).advance(50))
    assert watch_of(frames[:20] + frames[23:]).snapshot().lost == 3
    top = 2**32
    pairs = [(None, 7), (3, 4), (3, 6), (top - 1, 0), (top - 2, 1), (5000, 0)]
    assert [missing_frames(*pair) for pair in pairs] == [0, 0, 2, 0, 2, 0]
    stamps_ns = [21_000_000 * number for number in range(33) if number != 7]
    assert rate_mismatch(stamps_ns, 0.042) == ''
    expected = 'a frame comes every 21.0 ms, but bit_period is 33.3 ms'
    assert rate_mismatch(stamps_ns, 0.0333).startswith(expected)
    assert rate_mismatch(stamps_ns, 0.168) == ''
    assert '14.3 frames' in rate_mismatch(stamps_ns, 0.3)


# What is shown


@pytest.mark.parametrize(('grid', 'columns'), [(ZoneGrid(), 80), (ZoneGrid(8, 8), 100)])
def test_zones_lie_as_seen_from_the_sensor(grid: ZoneGrid, columns: int) -> None:
    lines = screen(snapshot(grid), ASCII)
    assert max(map(len, lines)) <= columns
    cells = [text.split('|') for text in lines if text.count('|') == grid.columns - 1]
    tops, bottoms = cells[::2], cells[1::2]
    numbers = [[int(cell.split()[0]) for cell in row] for row in tops]
    assert numbers == np.arange(grid.zones).reshape(grid.rows, grid.columns).tolist()
    signals = [[float(cell.split()[0]) for cell in row] for row in bottoms]
    assert signals == (np.array(numbers) + 0.5).tolist()
    assert bottoms[0][1].split()[1] in ('1.010', '1.01')
    assert tops[-1][-1].split()[-1] == '255'
    assert bottoms[-1][-1].split()[1] == '-'
    # Everything lies in columns.
    assert len({len(text) for text in lines if text.count('|') == grid.columns - 1}) == 1


@pytest.mark.parametrize('grid', [ZoneGrid(), ZoneGrid(8, 8)])
def test_the_chosen_zone_is_marked_and_its_bar_is_full(grid: ZoneGrid) -> None:
    text = '\n'.join(screen(snapshot(grid, 9), ASCII))
    assert re.findall(r'>(\d+) +(=+) ', text) == [('9', '=' * (10 if grid.rows == 4 else 3))]
    assert text.count('=') == (10 if grid.rows == 4 else 3)


def bits_of(hard: NDArray[np.uint8], first: int) -> NewestBits:
    signal = np.where(hard == 1, 10.0, 110.0)
    return NewestBits(signal, 10.0, 110.0, 20.0, ID, 0.9, first)


@pytest.mark.parametrize('symbols', [BLOCKS, ASCII])
def test_bits_are_drawn_dark_and_turned_into_the_packet(symbols: Symbols) -> None:
    bits = bits_of(np.roll(packet(ID), -5), 5)
    bits.signal[30] = np.nan
    lines = screen(replace(snapshot(ZoneGrid(), 9), bits=bits), symbols)
    (drawn,) = (text for text in lines if text.startswith('  bits'))
    sent = np.roll(packet(ID), -5)[:30]
    dark = ''.join(symbols.dark if bit else symbols.bright for bit in sent)
    assert drawn.split()[1] == dark + symbols.erased
    (soft,) = (text for text in lines if text.startswith('  soft'))
    assert soft[10:40] == dark.replace(symbols.bright, ' ').replace(symbols.dark, symbols.shades[4])
    (turned,) = (text for text in lines if text.startswith('  packet'))
    expected = ''.join(map(str, packet(ID)))
    expected = expected[:4] + '?' + expected[5:]
    assert ''.join(turned.split()[1:4]) == expected
    assert any(f'nearest ID {ID}: 0 of {PACKET_BITS} bits differ' in text for text in lines)
    wrong = packet(ID)
    wrong[12] ^= 1
    assert bits_of(wrong, 0).differing == 1


@pytest.mark.parametrize(
    ('reason', 'told'),
    [
        (Reason.EVIDENCE, 'evidence 20.5 of 28.0 nats'),
        (Reason.NOT_A_WORD, 'not a word, 41.5 nats, 8.0 allowed'),
        (Reason.MARGIN, 'margin 3.5 of 6.9 nats'),
        (Reason.ERASED, 'erased'),
    ],
)
def test_how_far_the_last_candidate_was_from_being_read(reason: Reason, told: str) -> None:
    known = replace(
        snapshot(ZoneGrid()),
        rejected={reason.value: 3},
        refused=Candidate(77, 9, 1, reason, 0, 0.042, 20.5, 41.5, 3.5),
        demands=Demands(28.0, 6.0, 8.0, 6.9, 9.2),
    )
    shown = '\n'.join(screen(known, ASCII))
    assert f'  refused so far: {reason.value} 3; last ID 77: {told}\n' in shown


@pytest.mark.parametrize(
    ('encoding', 'symbols'),
    [('utf-8', BLOCKS), ('cp437', BLOCKS), ('ascii', ASCII), ('latin-1', ASCII)],
)
def test_a_terminal_gets_what_its_encoding_has(encoding: str, symbols: Symbols) -> None:
    assert Symbols.of(encoding) is symbols
    bits = bits_of(packet(ID), 0)
    known = replace(snapshot(ZoneGrid(), 9), bits=bits)
    '\n'.join([*screen(known, symbols), line(known)]).encode(encoding)


def test_trouble_and_a_long_port_are_told_in_lines_that_fit() -> None:
    trouble = f'no permission to open /dev/{"x" * 60}; it belongs to the group dialout; retrying'
    lines = screen(Snapshot('port', trouble, 0.0, 0, 0, 0), BLOCKS)
    assert max(map(len, lines)) <= 80
    assert ' '.join(lines).endswith(f'! {trouble}')
    assert screen(snapshot(ZoneGrid()), ASCII)[0].endswith('0 damaged packets at port')
    port = '/dev/serial/by-id/usb-STMicroelectronics_STM32_STLink_0672FF-if02'
    head = screen(replace(snapshot(ZoneGrid()), port=port), ASCII)[0]
    assert head.startswith('47.6 frames/s, 100 frames, 0 lost, 0 damaged packets at ...')
    assert head.endswith('_0672FF-if02')
    assert len(head) == COLUMNS


def test_a_picture_that_is_cut_says_what_size_it_needs() -> None:
    (detection,) = (one.detection for one in known_readings())
    readings = [LastReading(detection, 1.0, 1)] * 3
    lines = screen(replace(snapshot(ZoneGrid(), 9), readings=readings), ASCII)
    assert len(lines) == ROWS
    assert fitted(lines, 80, 24) == lines
    assert fitted(lines, 80, 20) == [*lines[:19], 'enlarge the terminal to 80x24']
    narrow = fitted(lines, 60, 24)
    assert narrow[:-1] == [text[:60] for text in lines[:-1]]
    assert narrow[-1] == 'enlarge the terminal to 80x24'
    assert fitted(lines, 7, 1) == ['enlarge']
    large = screen(snapshot(ZoneGrid(8, 8)), ASCII)
    assert fitted(large, 80, 40)[-1] == f'enlarge the terminal to 95x{len(large)}'
    troubled = screen(replace(snapshot(ZoneGrid(), 9), trouble='a ' * 79, readings=readings), ASCII)
    assert fitted(troubled, 80, 24)[-1] == 'enlarge the terminal to 80x25'


# The command


def test_the_defaults_are_those_of_the_nodes() -> None:
    content = yaml.safe_load(shared_file('config/retrolidar.yaml').read_text(encoding='utf-8'))
    values: dict[str, object] = {}
    for section in content.values():
        values |= section['ros__parameters']
    options = parser().parse_args(['watch', 'port'])
    assert options.baud == values['serial_baud']
    assert options.protocol == values['protocol']
    assert detector_values(options)['bit_period'] == values['bit_period']


@pytest.mark.parametrize(
    ('option', 'message'),
    [
        (['--zone', '64'], '64 is no zone'),
        (['--zone=-1'], '-1 is no zone'),
        (['--zone', 'x'], 'x is no zone: they are 0 to 15, or 0 to 63'),
        (['--bit-period', '42ms'], '42ms is no NUMBER'),
        (['--duration', '1min'], '1min is no number of seconds'),
        (['--bit-period', '0.001'], '0.001 is not within 0.002 to 10'),
        (['--bit-period', '11'], '11.0 is not within'),
        (['--protocol', 'magic'], 'choose from'),
    ],
)
def test_impossible_options(option: list[str], message: str, capsys: Output) -> None:
    with pytest.raises(SystemExit, match='2'):
        main(['watch', 'port', *option])
    assert message in capsys.readouterr().err


def test_a_port_that_is_not_there_is_explained_even_to_a_closed_output(
    tmp_path: Path, capsys: Output
) -> None:
    assert main(['watch', str(tmp_path / 'port'), '--duration', '0.3']) == 1
    (told,) = capsys.readouterr().out.splitlines()
    assert 'port does not exist; is the sensor plugged in?; retrying; 0.0 frames/s' in told
    command = [*COMMAND, 'watch', str(tmp_path / 'port'), '--duration', '0.1']
    shell = ['sh', '-c', '"$@" >&-', 'sh', *command]
    result = subprocess.run(shell, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
    assert (result.returncode, result.stderr) == (1, '')


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Give the port of an emulated sensor that sees the coffee scene."""
    path = tmp_path_factory.mktemp('coffee') / 'port'
    command = [*COMMAND, 'emulate', 'coffee', '--port-link', str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert 'a sensor is at' in process.stdout.readline()
        yield path
        process.send_signal(signal.SIGINT)
        process.stdout.read()


def test_a_log_has_a_line_a_second(port: Path) -> None:
    began_s = time.monotonic()
    command = [*COMMAND, 'watch', str(port), '--duration', '6']
    result = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert (result.returncode, result.stderr) == (0, '')
    assert time.monotonic() - began_s > 6
    lines = result.stdout.splitlines()
    assert 3 <= len(lines) <= 7
    assert '\x1b' not in result.stdout
    assert re.search(r' 0 damaged packets; zone 9: .* kcps/SPAD, .* blinking 3\d\.\d dB', lines[-1])
    assert set(re.findall(r'last ID (\d+) at', result.stdout)) <= COFFEE
    assert 'last ID' in lines[-1]


def test_a_zone_that_is_not_there_ends_it(port: Path) -> None:
    command = [*COMMAND, 'watch', str(port), '--zone', '20']
    result = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
    assert result.returncode == 2
    assert result.stderr == 'retrolidar: --zone 20: the sensor has 4x4 zones, 0 to 15\n'


@pytest.mark.parametrize('request_to_end', [signal.SIGINT, signal.SIGTERM])
def test_a_terminal_shows_ids_and_is_restored(port: Path, request_to_end: signal.Signals) -> None:
    master, slave = pty.openpty()
    ioctl(slave, TIOCSWINSZ, pack('HHHH', 30, 100, 0, 0))
    environment = {**os.environ, 'TERM': 'linux', 'PYTHONIOENCODING': 'utf-8'}
    environment.pop('COLUMNS', None)
    environment.pop('LINES', None)
    process = subprocess.Popen(
        [*COMMAND, 'watch', str(port)], stdin=slave, stdout=slave, env=environment
    )
    os.close(slave)
    shown = b''

    def read() -> bool:
        nonlocal shown
        if not select.select([master], [], [], PATIENCE_S)[0]:
            return False
        try:
            shown += os.read(master, 65536)
        except OSError:  # the other end is closed
            return False
        return True

    def pictures() -> list[str]:
        return shown.decode(errors='replace').split('\x1b[H')

    def read_all() -> bool:
        # Markers may be read before the last of 31 bits has come.
        wanted = {*COFFEE, '1010101 100000011001 001100100001'}
        return len(pictures()) > 2 and all(text in pictures()[-2] for text in wanted)

    try:
        while not read_all():
            assert read(), pictures()[-1]
        process.send_signal(request_to_end)
        while read():
            pass
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()
        os.close(master)
    assert shown.startswith(b'\x1b[?25l')
    assert shown.endswith(b'\x1b[?25h')
    picture = [text.removesuffix('\x1b[K') for text in pictures()[-2].split('\r\n')]
    assert max(map(len, picture)) <= 100
    assert any('>9  ███' in text for text in picture)
