# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The picture of `retrolidar watch`."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from test_watch_state import ID, SCENE, frame, watch_of

from retrolidar_ros.cli.watch_view import (
    BRIGHT,
    DARK,
    ERASED,
    ROWS,
    LastReading,
    Snapshot,
    fitted,
    screen,
)
from retrolidar_ros.detector.newest_bits import NewestBits
from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene import Simulation
from retrolidar_ros.sensor.frame import ZoneGrid


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


def bits_of(hard: NDArray[np.uint8]) -> NewestBits:
    return NewestBits(np.where(hard == 1, 10.0, 110.0), 10.0, 110.0)


def test_bits_are_drawn_dark() -> None:
    bits = bits_of(np.roll(packet(ID), -5))
    bits.signal[30] = np.nan
    lines = screen(replace(snapshot(ZoneGrid(), 9), bits=bits))
    (drawn,) = (text for text in lines if text.startswith('  bits'))
    sent = np.roll(packet(ID), -5)[:30]
    dark = ''.join(DARK if bit else BRIGHT for bit in sent)
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
    large = screen(snapshot(ZoneGrid(8, 8)))
    assert fitted(large, 80, 40)[-1] == f'enlarge the terminal to 95x{len(large)}'
    troubled = screen(replace(snapshot(ZoneGrid(), 9), trouble='a ' * 79, readings=readings))
    assert fitted(troubled, 80, 21)[-1] == 'enlarge the terminal to 80x22'
