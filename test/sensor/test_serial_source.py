# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A serial port that comes and goes, is refused or is no port, and is read in between."""

import errno
import os
import re
import stat
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from queue import Queue
from typing import Any

import numpy as np
import pytest
import serial
from st_board import Reading

from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Surface
from retrolidar_ros.scene.emulator import PortLink
from retrolidar_ros.sensor import serial_source
from retrolidar_ros.sensor.serial_source import SerialSource, explain
from retrolidar_ros.sensor.wire import FrameReader, WireCounts, encode_frame

PACKETS = [encode_frame(frame) for frame in Simulation(Scene(surfaces=(Surface(1, 9),))).advance(9)]


Read = Callable[[], Reading]
Patch = pytest.MonkeyPatch


@pytest.fixture
def soon(monkeypatch: Patch) -> None:
    monkeypatch.setattr(serial_source, 'RETRY_S', 0.02)


@pytest.fixture
def read(link: Path) -> Iterator[Read]:
    """Start to read the port; stop at the end of the test."""
    with ExitStack() as stack:

        def start() -> Reading:
            reading = Reading(link, 115200, FrameReader())
            stack.callback(reading.end)
            return reading

        yield start


def test_frames_come_byte_by_byte_with_the_time_of_their_arrival(link: Path, read: Read) -> None:
    with PortLink(link) as port:
        other = os.open(link, os.O_RDWR | os.O_NOCTTY)
        assert port.write(PACKETS[0] + PACKETS[1])  # before it is read: not for this reader
        reading = read()
        assert reading.report() == f'reading {link}'
        assert (reading.source.is_open, reading.source.problem) == (True, '')
        for sequence, packet in enumerate(PACKETS[2:], 2):
            sent_ns = time.time_ns()
            for byte in packet:
                assert port.write(bytes([byte]))
            frame, arrival_ns = reading.frames.get(timeout=10)
            assert sent_ns <= arrival_ns <= time.time_ns()
            assert frame.sequence == sequence
            np.testing.assert_array_equal(frame.signal, np.full(16, 9))
        os.close(other)
        assert reading.source.openings == 1
        assert reading.source.received.bytes == sum(map(len, PACKETS[2:]))
        assert reading.source.reader.counts.frames == len(PACKETS) - 2


@pytest.mark.usefixtures('soon')
def test_an_absent_port_is_told_once_and_awaited(
    link: Path, read: Read, monkeypatch: Patch
) -> None:
    tries: Queue[None] = Queue()
    real = serial.Serial

    def counted(*arguments: Any, **options: Any) -> serial.Serial:
        tries.put(None)
        return real(*arguments, **options)

    monkeypatch.setattr(serial, 'Serial', counted)
    reading = read()
    began_s = time.monotonic()
    for _ in range(5):
        tries.get(timeout=10)
    assert time.monotonic() - began_s > 3 * serial_source.RETRY_S
    assert reading.report() == f'{link} does not exist; is the sensor plugged in?; retrying'
    assert reading.reports.empty()
    assert not reading.source.is_open
    assert reading.source.problem == f'{link} does not exist; is the sensor plugged in?'
    with PortLink(link):
        assert reading.report() == f'reading {link}'
        assert reading.source.problem == ''


def test_a_port_that_comes_back_is_read_within_two_seconds(link: Path, read: Read) -> None:
    with PortLink(link) as port:
        reading = read()
        reading.report()
        assert port.write(PACKETS[0])
        assert reading.sequences(1) == [0]
    assert reading.report() == f'{link} was lost; is the sensor still plugged in?; retrying'
    # Once more, under the same name.
    with PortLink(link) as port:
        returned_s = time.monotonic()
        while (report := reading.report()) != f'reading {link}':
            assert report == f'{link} does not exist; is the sensor plugged in?; retrying'
        assert time.monotonic() - returned_s < 2
        assert port.write(PACKETS[1])
        assert reading.sequences(1) == [1]
    assert reading.source.openings == 2


@pytest.mark.usefixtures('soon')
def test_a_port_in_use_is_explained_and_opened_when_it_is_free(link: Path, read: Read) -> None:
    with PortLink(link):
        with serial.Serial(str(link), exclusive=True):
            reading = read()
            assert reading.report() == f'{link} is in use by another program; retrying'
            assert not reading.source.is_open
        assert reading.report() == f'reading {link}'
        # Now it keeps others out.
        with pytest.raises(serial.SerialException, match='exclusively lock') as caught:
            serial.Serial(str(link), exclusive=True)
    assert explain(caught.value, 'p') == 'p is in use by another program'


@pytest.mark.parametrize('kind', [stat.S_IFREG, stat.S_IFDIR, stat.S_IFCHR])
def test_what_is_no_port_is_refused_in_one_line(link: Path, read: Read, kind: int) -> None:
    if kind == stat.S_IFDIR:
        link.mkdir()
    elif kind == stat.S_IFREG:
        link.write_bytes(PACKETS[0])
    else:
        link.symlink_to('/dev/null')
    reading = read()
    assert reading.report() == f'{link} is not a serial port; retrying'
    assert reading.frames.empty()


REMEDY = 'it belongs to the group {0}: sudo usermod -aG {0} $USER, and log in again'


@pytest.mark.usefixtures('soon')
@pytest.mark.parametrize(
    ('owner', 'call', 'error', 'said'),
    [
        (os, 'open', PermissionError(errno.EACCES, 'x'), f'no permission to open {{1}}; {REMEDY}'),
        (serial, 'Serial', ValueError('Failed to set custom baud rate'), '{1}: Failed to set'),
        # Gone while it was being opened.
        (serial, 'Serial', termios.error(errno.EIO, 'Input/output error'), '{1}: .*output error'),
        (serial, 'Serial', serial.SerialException('Could not: (5, ...)'), r'{1}: Could not: \(5'),
    ],
)
def test_what_is_raised_is_said_and_a_reason_to_try_again(
    link: Path, read: Read, monkeypatch: Patch, owner: Any, call: str, error: Exception, said: str
) -> None:
    real, errors = getattr(owner, call), [error]

    def failing(path: Any, *arguments: Any, **options: Any) -> Any:
        if errors and str(path) == str(link):
            raise errors.pop()
        return real(path, *arguments, **options)

    with PortLink(link):
        monkeypatch.setattr(owner, call, failing)
        reading = read()
        wanted = said.replace('$', r'\$').format(link.group(), link)
        assert re.fullmatch(f'{wanted}.*; retrying', reading.report())
        assert reading.report() == f'reading {link}'


@pytest.mark.parametrize('sent', [b'', b''.join(PACKETS)])
def test_a_source_stops_while_frames_come_or_not(link: Path, read: Read, sent: bytes) -> None:
    with PortLink(link) as port:
        reading = read()
        reading.report()
        if sent:
            assert port.write(sent)
            reading.sequences(1)
        assert reading.end() < 1
        assert not reading.source.is_open
        serial.Serial(str(link), exclusive=True).close()  # and the port is free again


def test_a_source_stops_without_a_port(link: Path, read: Read, monkeypatch: Patch) -> None:
    monkeypatch.setattr(serial_source, 'RETRY_S', 60)
    reading = read()
    reading.report()
    assert reading.end() < 1
    # Stopped before it runs, it opens nothing.
    reports: list[str] = []
    source = SerialSource(str(link), 115200, FrameReader())
    source.run(lambda frames, arrival_ns: None, reports.append, reading.stop)
    assert reports == []
    assert source.problem == f'{link} has not been opened yet'


def test_silence_is_explained_by_what_has_come() -> None:
    then = WireCounts(bytes=10, bad_crc=2, withheld=3)
    for now, said in (
        (WireCounts(bytes=30, bad_crc=3, withheld=4), 'frames come without signal'),
        (WireCounts(bytes=30, bad_crc=3, withheld=3), 'no frames come, but damaged packets'),
        (WireCounts(bytes=30, bad_crc=2, withheld=3), 'no frames come, but 20 bytes'),
        (then, 'nothing comes'),
    ):
        assert now.silence(then).startswith(said)
