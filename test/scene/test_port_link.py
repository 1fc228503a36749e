# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The pseudo-terminal of an emulated sensor: what is written to it, and what a reader gets."""

import itertools
import os
import select
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
import serial
from harness_frames import make_packets, sequences
from harness_serial import listen

from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.emulator import PortLink, emulate
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.wire import FrameReader, encode_frame


@contextmanager
def raw_reader(port: Path) -> Iterator[int]:
    """Open the port without emptying its buffers, as not every program does."""
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    yield descriptor
    os.close(descriptor)


def read_raw(descriptor: int, reader: FrameReader, count: int) -> list[Frame]:
    """Read until `count` frames have come, or nothing comes for a second."""
    frames: list[Frame] = []
    while len(frames) < count and select.select([descriptor], [], [], 1)[0]:
        frames += reader.feed(os.read(descriptor, 65536))
    return frames


def test_all_bytes_pass_unchanged(link: Path) -> None:
    data, read = bytes(range(256)) * 4, b''
    # Not even a reader that leaves the terminal as it is gets lines, echoes or signals.
    with PortLink(link) as port, raw_reader(link) as descriptor:
        assert port.write(data)
        while len(read) < len(data) and select.select([descriptor], [], [], 1)[0]:
            read += os.read(descriptor, 65536)
    assert read == data


def test_the_link_is_there_as_long_as_the_port(link: Path) -> None:
    with suppress(KeyboardInterrupt), PortLink(link):
        assert link.is_symlink()
        assert link.is_char_device()
        line = listen(link)
        raise KeyboardInterrupt  # even when the work fails
    assert not link.is_symlink()
    with pytest.raises(serial.SerialException), line:
        line.read(1)
    link.symlink_to('/dev/pts/9999')  # as a killed emulator leaves it
    with PortLink(link) as port, listen(link):
        assert port.write(b'x')
        link.unlink()
    assert not link.exists()


@pytest.mark.parametrize('kind', ['/dev/null', 'nowhere', 'file', 'directory', 'port'])
def test_what_is_there_already_is_refused_and_kept(link: Path, tmp_path: Path, kind: str) -> None:
    with PortLink(tmp_path / 'live') as live:
        match kind:
            case 'file':
                link.write_text('precious')
            case 'directory':
                link.mkdir()
            case 'port':
                link.symlink_to(os.readlink(tmp_path / 'live'))
            case goal:
                link.symlink_to(goal)
        before = os.readlink(link) if link.is_symlink() else link.stat()
        with pytest.raises(FileExistsError, match='port exists; give a path'):
            PortLink(link)
        with pytest.raises(FileExistsError, match='port exists; give a path'):
            emulate(Scene(), link, 1.0)
        assert before == (os.readlink(link) if link.is_symlink() else link.stat())
        with listen(tmp_path / 'live') as line:
            assert live.write(b'abc')
            assert line.read(3) == b'abc'


def test_an_impossible_path_leaves_no_open_terminal(tmp_path: Path) -> None:
    before = len(os.listdir('/dev/fd'))
    with pytest.raises(FileNotFoundError):
        PortLink(tmp_path / 'missing' / 'port')
    assert len(os.listdir('/dev/fd')) == before


def test_what_a_listener_left_unread_is_not_for_the_next(link: Path) -> None:
    reader = FrameReader()
    with PortLink(link) as port:
        with raw_reader(link):
            while port.write(make_packets(1)[0]):
                pass
        assert not port.write(b'nobody hears this')
        with raw_reader(link) as second:
            assert port.write(make_packets(8)[7])
            assert sequences(read_raw(second, reader, 1)) == [7]
            assert reader.counts.damaged == 0
            # Nor does a packet that was cut off, longer than any terminal takes, cost the next.
            assert not port.write(b'x' * 100_000)
            while select.select([second], [], [], 0.1)[0]:
                assert reader.feed(os.read(second, 65536)) == []
            assert port.write(make_packets(1)[0])
            assert sequences(read_raw(second, reader, 1)) == [0]
            assert reader.counts.damaged == 1


def test_a_listener_that_is_slow_gets_some_packets_and_never_a_wrong_one(link: Path) -> None:
    sent, reader = make_packets(1400), FrameReader()
    frames: list[Frame] = []
    taken: list[bool] = []
    with PortLink(link) as port, raw_reader(link) as descriptor:
        for packet in sent:
            taken.append(port.write(packet))
            # At first it does not read at all.
            if len(taken) > 400 and select.select([descriptor], [], [], 0)[0]:
                frames += reader.feed(os.read(descriptor, 77))
        frames += read_raw(descriptor, reader, sum(taken) - len(frames))
    full = taken.index(False)
    assert full > 20  # some hundred milliseconds are buffered
    assert sum(taken[full:400]) < 20  # the terminal may still move what it holds
    numbers = sequences(frames)
    assert full + 20 < len(numbers) == sum(taken) < 1400
    assert numbers == sorted(set(numbers))
    torn = sum(before and not now for before, now in itertools.pairwise([True, *taken]))
    assert reader.counts.damaged <= torn
    for frame in frames:
        assert encode_frame(frame) == sent[frame.sequence]
