# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retrolidar_ros.detector.place import largest_stddev
from retrolidar_ros.sensor.rotation import matrix_of
from retrolidar_ros.tasks.objects import ObjectBoard

S = 1_000_000_000
SHARP = np.diag([1e-4, 1e-4, 1e-6])  # 1 cm
NAMES = ('beans', 'machine', 'mug')


def new_board() -> ObjectBoard:
    return ObjectBoard(NAMES, max_stddev_m=0.15, stale_after_s=10.0)


def see_all(board: ObjectBoard, stamp_ns: int) -> None:
    for place, name in enumerate(board.names):
        board.see(name, stamp_ns, 'base', np.full(3, float(place)), SHARP)


def test_a_board_needs_names_and_each_but_once() -> None:
    with pytest.raises(ValueError, match=r'^objects: there is no name; name at least one$'):
        ObjectBoard([], 0.1, 10.0)
    with pytest.raises(ValueError, match=r'^objects: mug comes twice$'):
        ObjectBoard(['beans', 'mug', 'cup', 'mug'], 0.1, 10.0)
    assert ObjectBoard(['mug', 'beans'], 0.1, 10.0).names == ('mug', 'beans')


def test_what_has_not_been_seen_is_missing() -> None:
    board = new_board()
    board.see('cup', 0, 'base', np.ones(3), SHARP)  # which nobody asked for
    assert list(board.missing(0).items()) == [(name, 'has not been seen') for name in NAMES]
    assert board.offsets(0) == {}
    board.see('machine', 0, 'base', np.zeros(3), SHARP)
    assert set(board.missing(0)) == {'beans', 'mug'}
    see_all(board, 5 * S)
    # A stamp ahead of the clock is not stale.
    assert board.missing(0) == board.missing(6 * S) == {}


def test_a_sighting_counts_until_it_is_stale() -> None:
    board = new_board()
    see_all(board, 5 * S)
    board.see('mug', 8 * S, 'base', np.zeros(3), SHARP)
    assert board.missing(15 * S) == {}
    assert board.missing(17 * S) == dict.fromkeys(NAMES[:2], 'was last seen 12 s ago')
    assert board.missing(19 * S)['mug'] == 'was last seen 11 s ago'
    board.stale_after_s = 20.0
    assert board.missing(19 * S) == {}


def test_an_uncertain_place_is_missing_until_it_is_seen_better() -> None:
    board = new_board()
    see_all(board, 0)
    board.see('mug', S, 'base', np.zeros(3), np.diag([1e-4, 0.09, 1e-4]))
    assert board.missing(S) == {'mug': '±300 mm (±150 mm needed)'}
    # The latest counts, not the best.
    board.see('mug', 2 * S, 'base', np.zeros(3), SHARP)
    assert board.missing(2 * S) == {}
    board.max_stddev_m = 0.005
    assert set(board.missing(2 * S)) == set(NAMES)
    # Stale goes before uncertain.
    assert board.missing(20 * S)['mug'] == 'was last seen 18 s ago'


def test_the_largest_deviation_of_any_axes() -> None:
    turn = matrix_of(np.array([0.3, -0.5, 0.1, 0.8]))
    covariance = turn @ np.diag([4.0, 9.0, 1.0]) @ turn.T
    assert largest_stddev(covariance) == pytest.approx(3.0)
    assert largest_stddev(np.diag([-1e-20, -1e-20, -1e-20])) == 0


@given(st.permutations(range(5)), st.integers(0, 20))
def test_the_order_in_which_sightings_come_does_not_matter(order: list[int], now_s: int) -> None:
    board = ObjectBoard(['beans', 'mug'], 0.15, 10.0)
    board.see('beans', 0, 'base', np.zeros(3), SHARP)
    for second in order:
        # An older one does not count, and neither does how uncertain it was.
        covariance = SHARP if second == 4 else np.eye(3)
        board.see('mug', second * S, 'base', np.full(3, float(second)), covariance)
    assert board.offsets(0)['beans', 'mug'].tolist() == [4, 4, 4]
    assert ('mug' in board.missing(now_s * S)) == (now_s - 4 > 10)
    # Of the same time the later call counts.
    board.see('mug', 4 * S, 'base', np.full(3, 5.0), SHARP)
    assert board.offsets(0)['beans', 'mug'].tolist() == [5, 5, 5]


def test_offsets_are_of_objects_that_are_placed_in_one_frame() -> None:
    for frame, offsets in (('base', 1), ('right', 0)):
        board = ObjectBoard(['beans', 'mug'], 0.15, 10.0)
        assert board.see('beans', 0, 'base', np.zeros(3), SHARP)
        assert board.see('mug', S, frame, np.ones(3), SHARP)
        assert len(board.offsets(S)) == offsets
        assert board.offsets(11 * S) == {}
    assert board.missing(S) == {'beans': 'was seen in base, others in right'}


def test_what_is_no_number_is_no_sighting() -> None:
    board = ObjectBoard(['mug'], 0.15, 10.0)
    board.see('mug', 0, 'base', np.ones(3), np.full((3, 3), np.nan))
    assert 'mug' in board.missing(0)
