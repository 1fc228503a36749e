# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor is told, what it answers, and what follows from that."""

from concurrent.futures import ThreadPoolExecutor, wait

import pytest
from harness_frames import make_frame, make_packets, reader_in_step, sequences

from retrolidar_ros.scene.emulator import EmulatedFirmware
from retrolidar_ros.sensor.identity import Command, Commands, Identity, encode_identity
from retrolidar_ros.sensor.wire import FrameReader, encode_packet

RANGING = Identity('1.2.3', '000102030405060708090a0b', True)
STOPPED = RANGING._replace(is_ranging=False)
IDENTIFY, START, STOP = (one.line() for one in (Command.IDENTIFY, Command.START, Command.STOP))


def packet_of(identity: Identity) -> bytes:
    return encode_packet(encode_identity(identity))


def test_an_identity_between_frames_is_taken_and_is_no_error() -> None:
    assert encode_identity(RANGING) == bytes([2, 1, 2, 3, 1, *range(12)])  # as the protocol says
    reader = reader_in_step()
    first, second = make_packets(2)
    assert sequences(reader.feed(first + packet_of(RANGING) + second)) == [0, 1]
    assert reader.commands.identity == RANGING
    assert (reader.counts.damaged, reader.counts.unknown_kind) == (0, 0)


def test_who_is_there_is_asked_whenever_the_port_opens() -> None:
    reader = FrameReader()
    assert reader.request() == b''
    for _ in range(2):
        reader.feed(packet_of(STOPPED))  # which is to be started, but has gone before it is told
        reader.restart()
        assert reader.commands.identity is None
        assert reader.request() == IDENTIFY
        assert reader.request() == b''


def test_a_sensor_that_was_stopped_by_another_is_started_and_told_so_once() -> None:
    commands = Commands()
    commands.take(STOPPED)
    assert commands.request() == START
    commands.take(STOPPED)
    assert commands.request() == b''
    commands.take(RANGING)
    commands.take(STOPPED)
    assert commands.request() == START


def test_a_sensor_that_does_not_obey_or_answer() -> None:
    commands = Commands()
    with pytest.raises(TimeoutError, match='no answer to stop'):
        commands.ask(Command.STOP, 0.0)
    commands.restart()
    commands.request()
    commands.take(RANGING)  # another sensor, which nobody has stopped
    assert commands.request() == b''
    with ThreadPoolExecutor(1) as pool:
        for timeout_s in (0.3, 20.0):
            asked = pool.submit(commands.ask, Command.STOP, timeout_s)
            while not commands.request():
                pass
            commands.take(RANGING)
            assert not wait((asked,), 0.1).done
            if timeout_s > 1:  # one that obeys at last is not waited for any longer
                commands.take(STOPPED)
            assert asked.result(10) == (timeout_s > 1)


def test_an_emulated_sensor_obeys_lines_and_nothing_else() -> None:
    firmware, other = EmulatedFirmware('a'), EmulatedFirmware('b')
    reader = reader_in_step()

    def passed(sequence: int) -> list[tuple[int, int]]:
        frames = reader.feed(firmware.encode(make_frame(sequence=sequence)))
        return [(frame.sequence, frame.sensor_time_us) for frame in frames]

    assert passed(0) == [(0, 0)]
    assert firmware.answer(b'sto') + firmware.answer(b'p it\n\n\xff\nx' + b'stop' * 99) == b''
    assert passed(1) == [(1, 21_000)]
    reader.feed(firmware.answer(b'\nst') + firmware.answer(b'op\n'))
    identity = reader.commands.identity
    assert identity is not None
    assert not identity.is_ranging
    assert (passed(2), passed(3)) == ([], [])
    reader.feed(firmware.answer(START))
    assert reader.commands.identity == identity._replace(is_ranging=True)
    assert passed(4) == [(2, 84_000)]
    reader.feed(firmware.answer(Command.RESET.line()))
    assert [*passed(5), *passed(6)] == [(0, 0), (1, 21_000)]
    assert reader.feed(other.answer(IDENTIFY)) == []
    assert reader.commands.identity.serial != identity.serial
