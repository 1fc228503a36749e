# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from retrolidar_ros.tasks.heartbeat import WINDOW_S, Heartbeat

law = settings(deadline=None)
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
    assert heart.silence_s(100.5) == pytest.approx(0.1)
    assert heart.longest_silence_s(100.5) == pytest.approx(0.4)
    assert heart.beats == 6


def test_time_begins_with_the_first_call() -> None:
    heart = Heartbeat()
    assert heart.window_s == WINDOW_S == 10
    assert counts(heart) == (0, 0, 0)
    heart.advance(1e6)
    assert counts(heart) == (0, 0, 0)
    assert heart.silence_s(1e6 + 3) == 3
    assert heart.longest_silence_s(1e6 + 3) == 3


def test_a_clock_that_is_set_forward_begins_anew() -> None:
    heart = beaten([0.0, 1.0])
    heart.beat(1.8e9)
    assert counts(heart) == (1, 0, 0)
    assert heart.longest_silence_s(1.8e9) == 0


@law
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


@law
@given(beats, windows, st.floats(0.01, 1000), st.booleans())
def test_time_may_go_back(
    times: list[float], window_s: float, back_s: float, is_beat: bool
) -> None:
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
