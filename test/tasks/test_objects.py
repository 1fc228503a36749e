# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What tasks keep: where objects were seen last, and whether markers still are."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retrolidar_ros.tasks.heartbeat import WINDOW_S, Heartbeat
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


# Halves and quarters of seconds add up exactly.
quarters = st.integers(0, 400).map(lambda count: count / 4)
# So long that no jump is taken for a clock that was set.
windows = st.sampled_from([1.0, 1.5, 2.5, 10.0])
beats = st.lists(quarters, min_size=1, max_size=30).map(sorted)


def beaten(times: list[float], window_s: float = WINDOW_S) -> Heartbeat:
    heart = Heartbeat(window_s)
    for time_s in times:
        heart.beat(time_s)
    return heart


def counts(heart: Heartbeat) -> tuple[int, int, int]:
    return heart.beats, heart.windows, heart.windows_alive


def test_a_track_without_light_is_silence() -> None:
    heart = beaten([100.0])
    for dark in range(1, 5):
        heart.beat(100 + dark / 10, unseen_s=dark / 10)
    assert heart.silence_s(100.5) == pytest.approx(0.5)
    heart.beat(100.5, unseen_s=0.1)
    assert heart.beats == 2  # not the times without light
    assert heart.silence_s(100.5) == pytest.approx(0.1)
    assert heart.longest_silence_s(100.5) == pytest.approx(0.4)


def test_a_clock_that_is_set_forward_begins_anew() -> None:
    heart = beaten([0.0, 1.0])
    heart.beat(1.8e9)
    assert counts(heart) == (1, 0, 0)
    assert heart.longest_silence_s(1.8e9) == 0


def test_a_clock_that_is_set_back_hides_no_silence() -> None:
    heart = beaten([100.0, 109.0])
    heart.advance(101.0)
    assert heart.silence_s(108.0) == pytest.approx(7.0)


@given(beats, windows, quarters)
def test_windows_and_silences_are_counted_as_by_hand(
    times: list[float], window_s: float, later_s: float
) -> None:
    heart = beaten(times, window_s)
    end_s = times[-1] + later_s
    heart.advance(end_s)
    places = [int((time_s - times[0]) // window_s) for time_s in times]
    whole = int((end_s - times[0]) // window_s)
    assert counts(heart) == (len(times), whole, len({place for place in places if place < whole}))
    gaps = [after - before for before, after in itertools.pairwise([*times, end_s])]
    assert heart.silence_s(end_s) == later_s
    # Asking changes nothing, even of a later time.
    assert heart.longest_silence_s(end_s + 1000) >= 1000
    assert heart.longest_silence_s(end_s) == max(gaps)


@given(beats, windows, st.floats(0.01, 1000), st.booleans())
def test_time_goes_back(times: list[float], window_s: float, back_s: float, is_beat: bool) -> None:
    heart = beaten(times, window_s)
    heart.advance(times[-1] + 100.0)
    time_s = times[0] - back_s
    if is_beat:
        heart.beat(time_s)
    else:
        heart.advance(time_s)
    assert counts(heart) == (int(is_beat), 0, 0)
    assert heart.silence_s(time_s) == heart.longest_silence_s(time_s) == 0
    assert heart.silence_s(time_s + 0.5) == pytest.approx(0.5)
    heart.advance(time_s + 1.5 * window_s)
    assert counts(heart) == (int(is_beat), 1, int(is_beat))


def test_readings_that_come_a_little_out_of_order_count_and_restart_nothing() -> None:
    heart = beaten([0.0, 5.0, 4.0])
    assert heart.silence_s(7.0) == 2
    heart.beat(6.0)
    heart.advance(10.0)
    assert counts(heart) == (4, 1, 1)
    assert heart.silence_s(10.0) == 4
    assert heart.longest_silence_s(6.0) == 5
