# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Chosen IDs keep their distance by an independent count, and those too near are named."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from retrolidar_ros.cli.main import main
from retrolidar_ros.marker.code import IDS, RESERVED_IDS, packet
from retrolidar_ros.marker.dictionary import (
    USABLE_IDS,
    ConfusablePair,
    choose_ids,
    confusable_pairs,
    distances,
)

Output = pytest.CaptureFixture[str]

FOUND = {2: 4094, 6: 1708, 8: 314, 10: 15, 12: 4, 14: 1}

sets = st.lists(st.integers(0, IDS - 1), min_size=1, max_size=6, unique=True)
PACKETS = [''.join(map(str, bits)) for bits in packet(np.arange(IDS)).tolist()]


@pytest.fixture(scope='module')
def everything() -> NDArray[np.uint8]:
    return distances(np.arange(IDS))


def counted(first: int, second: int) -> list[tuple[int, int]]:
    """Count, in text, how many bits differ at each shift, as pairs of distance and shift."""
    sent, other = PACKETS[first], PACKETS[second]
    return [
        (sum(a != b for a, b in zip(sent[shift:] + sent[:shift], other, strict=True)), shift)
        for shift in range(1 if first == second else 0, len(sent))
    ]


@settings(max_examples=30)
@given(chosen=sets, limit=st.integers(1, 31), data=st.data())
def test_distances_and_pairs_counted(chosen: list[int], limit: int, data: st.DataObject) -> None:
    every = [[ConfusablePair(a, b, *min(counted(a, b))) for b in chosen] for a in chosen]
    expected = [[pair.distance for pair in row] for row in every]
    np.testing.assert_array_equal(distances(chosen), expected)
    flat = [pair for row in every for pair in row]
    pairs = [pair for pair in flat if pair.first <= pair.second and pair.distance < limit]
    pairs.sort(key=lambda pair: (pair.distance, pair.first, pair.second))
    assert confusable_pairs(chosen, limit) == pairs
    assert confusable_pairs(data.draw(st.permutations(chosen)), limit) == pairs


@pytest.mark.parametrize(('min_distance', 'count'), FOUND.items())
def test_as_many_as_published(min_distance: int, count: int, everything: NDArray[np.uint8]) -> None:
    chosen, distance = choose_ids(count, min_distance)
    assert len(set(chosen.tolist())) == len(chosen) == count
    assert np.isin(chosen, USABLE_IDS).all()
    assert distance == everything[np.ix_(chosen, chosen)].min() == min_distance
    if count < len(USABLE_IDS):
        with pytest.raises(ValueError, match=f'{count + 1} IDs .* {min_distance} bits .* {count}:'):
            choose_ids(count + 1, min_distance)


def test_no_id_could_be_added_to_all_that_are_found(everything: NDArray[np.uint8]) -> None:
    chosen, distance = choose_ids(FOUND[8], 8)
    fits = (everything[:, chosen] >= distance).all(axis=1) & (everything.diagonal() >= distance)
    assert not np.setdiff1d(np.flatnonzero(fits), [*chosen, *RESERVED_IDS]).size
    assert confusable_pairs(chosen) == []
    # An odd distance is the even one above.
    np.testing.assert_array_equal(choose_ids(FOUND[8], 7)[0], chosen)
    assert choose_ids(FOUND[8], 7)[1] == 8


@pytest.mark.parametrize(('count', 'distance'), [(1, 14), (2, 12), (5, 10), (16, 8), (314, 8)])
def test_the_usual_distance_is_the_largest_at_which_so_many_fit(count: int, distance: int) -> None:
    chosen, reached = choose_ids(count)
    assert reached == distance
    np.testing.assert_array_equal(chosen, choose_ids(count, distance)[0])


@pytest.mark.parametrize('min_distance', [5, 8])
def test_a_choice_is_the_same_every_time_and_begins_a_larger_one(min_distance: int) -> None:
    larger, distance = choose_ids(60, min_distance)
    kept = larger.copy()
    larger[:] = 0  # what is returned belongs to the caller
    for fewer in (1, 2, 20, 60):
        smaller, distance_of_smaller = choose_ids(fewer, min_distance)
        np.testing.assert_array_equal(smaller, kept[:fewer])
        assert distance_of_smaller >= distance >= min_distance
    assert choose_ids(20)[0][:8].tolist() == [2061, 2073, 2816, 2865, 2127, 2150, 2115, 2528]


def test_the_command_prints_ids_that_it_finds_good(capsys: Output) -> None:
    assert main(['ids', '--count', '20']) == 0
    output = capsys.readouterr()
    lines = output.out.splitlines()
    assert [int(line) for line in lines] == choose_ids(20)[0].tolist()
    assert output.err == 'IDs: 20, least distance: 8 bits\n'
    assert main(['ids', '--check', ','.join(lines)]) == 0
    assert capsys.readouterr().out == 'IDs: 20, least distance: 8 bits\n'
    assert main(['ids', '--count', '2', '--min-distance', '6']) == 0
    assert capsys.readouterr().out.split() == [str(i) for i in choose_ids(2, 6)[0]]


@pytest.mark.parametrize(
    ('checked', 'least', 'lines'),
    [
        ('106,26,99', 2, ['26 read from bit 2 differs from 106 in 2 bits']),
        ('1', 4, ['1 read from bit 2 differs from itself in 4 bits']),
    ],
)
def test_bad_sets_are_named(checked: str, least: int, lines: list[str], capsys: Output) -> None:
    assert main(['ids', '--check', checked]) == 1
    head = f'IDs: {checked.count(",") + 1}, least distance: {least} bits'
    assert capsys.readouterr().out.splitlines() == [head, *lines]
    assert main(['ids', '--check', checked, '--min-distance', str(least)]) == 0


def test_reserved_and_double_ids_are_wrong_at_any_distance(capsys: Output) -> None:
    assert main(['ids', '--check', '99,4095,99,0', '--min-distance', '1']) == 1
    assert capsys.readouterr().out.splitlines() == [
        'IDs: 4, least distance: 0 bits',
        *(f'{one} is reserved: after the preamble it never changes' for one in (0, 4095)),
        '99 is there more than once',
    ]
