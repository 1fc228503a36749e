# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What parts of the decision buy: each test fails without the parts that it names."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluation.bench import room_families
from evaluation.bench.room_scene import Room
from evaluation.bench.room_truth import Scored
from evaluation.bench.rooms import play, play_room
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.description import Surface
from retrolidar_ros.scene.reference import WALL_SIGNAL


def whole(scored: Scored) -> list[bool]:
    """Return of each packet that was seen whole whether it was read."""
    return [one for packet, one in zip(scored.sent, scored.read, strict=True) if packet.whole]


Make = Callable[[np.random.Generator], Room]


def played(make: Make, part: int, rooms: int) -> tuple[float, int]:
    """Return which share of the packets was read, and how many IDs were wrong."""
    read: list[bool] = []
    wrong = 0
    for number in range(rooms):
        rng = np.random.default_rng([77, part, number])
        scored = play_room(0, make(rng), rng).scored
        read += whole(scored)
        wrong += len(scored.wrong)
    return sum(read) / max(len(read), 1), wrong


def pair(ratio: float, first: str, second: str, woken: bool = False) -> Make:
    return lambda rng: room_families.pair(ratio, (first, second), rng, woken=woken)


@pytest.mark.parametrize(
    ('make', 'part', 'rooms', 'least', 'most_wrong'),
    [
        # By interferers, pairs and residuals; of ever other IDs by stretches and packets as one.
        (pair(1.0, 'repeating', 'repeating'), 16, 4, 0.85, 0),
        (pair(0.5, 'repeating', 'sequence'), 16, 4, 0.75, 0),
        (pair(0.5, 'sequence', 'sequence'), 16, 4, 0.8, 0),
        # By a search of the residual at the packet's own time, its gains, and as two are expected.
        (pair(0.95, 'sequence', 'sequence', woken=True), 51, 8, 0.67, 4),
        # By rivals of the same sum that explain the same samples as the pair.
        (pair(0.98, 'repeating', 'repeating', woken=True), 52, 4, 0.7, 0),
        # By the margin over rivals.
        (lambda rng: room_families.ten_packets(150.0, rng), 1, 3, 0.95, 2),
        # By an interferer's gain that changes, and the word test; all, as readings keep time.
        (lambda rng: room_families.crossing(0.3, 40.0, rng), 8, 6, 0.99, 0),
        # By other periods, where packets are combined; these bits are no packets.
        (lambda rng: room_families.other_period(0.021, 60.0, rng), 41, 4, 0.0, 0),
    ],
    ids=[
        *('two that repeat', 'one of two repeats', 'neither repeats'),
        *('woken together', 'woken together and repeat'),
        *('ever other IDs', 'crosses the view', 'another period'),
    ],
)
def test_packets_are_read_and_not_taken_for_others(
    make: Make, part: int, rooms: int, least: float, most_wrong: int
) -> None:
    read, wrong = played(make, part, rooms)
    assert read >= least
    assert wrong <= most_wrong


def test_a_fainter_marker_in_the_same_zone_has_a_range_of_its_own() -> None:
    """By the light of the other marker, which is fitted along."""
    off_m = []
    for number in range(5):
        rng = np.random.default_rng([77, 7, number])
        room = room_families.pair(0.5, ('repeating', 'repeating'), rng)
        off_m += [abs(one.error.range_m) for one in play_room(0, room, rng).scored.placed]
    assert len(off_m) >= 80
    assert np.median(off_m) < 0.01


def test_the_page_has_all_ids_with_another_packet_in_the_midst_of_two() -> None:
    def value(bits: NDArray[np.uint8]) -> NDArray[np.int64]:
        return bits @ (1 << np.arange(PACKET_BITS, dtype=np.int64))

    packets = packet(USABLE_IDS)
    known = set(value(packets).tolist())
    found: set[int] = set()
    for pause in range(1, 11):
        bits = np.concatenate([packets, np.zeros((len(packets), pause), np.uint8), packets], axis=1)
        for begin in range(1, PACKET_BITS + pause):
            values = value(bits[:, begin : begin + PACKET_BITS]).tolist()
            found.update(USABLE_IDS[[value in known for value in values]].tolist())
    page = (Path(__file__).parents[2] / 'docs' / 'choosing.md').read_text(encoding='utf-8')
    *ids, last = map(str, sorted(found))
    assert f'{", ".join(ids)} and {last}' in page.replace('\n', ' ')


@pytest.mark.parametrize(
    ('seed', 'speed_m_s', 'run'),
    [
        pytest.param(10842, 0.3, 6, id='gains of interferers'),
        pytest.param(10844, 0.6, 5, id='gains of interferers, too'),
        pytest.param(10850, 0.1, 7, id='slowly'),
    ],
)
def test_a_marker_that_fades_is_read_as_no_other(seed: int, speed_m_s: float, run: int) -> None:
    """Another ID that begins with the same bits explains its light as well."""
    rng = np.random.default_rng([seed, int(100 * speed_m_s), run])
    scored = play_room(0, room_families.crossing(speed_m_s, 20.0, rng), rng).scored
    assert scored.wrong == []
    assert sum(whole(scored)) >= 10


@pytest.mark.parametrize(
    ('seed', 'number'),
    [
        pytest.param(9401, 35, id='gain that changes'),
        pytest.param(9401, 111, id='gain that changes, too'),
        pytest.param(281172800, 47, id='vanishes'),
        pytest.param(10733, 116, id='bits of the search'),
        pytest.param(8110, 9, id='bits not known'),
        pytest.param(10301, 63, id='bits not known of what appeared'),
        pytest.param(10001, 169, id='preamble'),
        pytest.param(10731, 15, id='preamble not known'),
        pytest.param(10506, 154, id='sums of zones'),
        pytest.param(10733, 42, id='several in a sum of zones'),
        pytest.param(10923, 263, id='crosses beside others'),
        pytest.param(10733, 40, id='zones beside, again'),
        pytest.param(10760, 50, id='placed beside what is known'),
        pytest.param(10992, 254, id='start among others'),
        pytest.param(10996, 21, id='other bits among others'),
    ],
)
def test_no_id_of_a_random_room_is_wrong(seed: int, number: int) -> None:
    """By what each room is named for: of rivals, interferers and the word test."""
    scored = play(number, seed).scored
    assert scored.wrong == []
    assert sum(scored.read) >= min(8, len(scored.read))


@pytest.mark.parametrize(
    ('seed', 'number', 'min_read'),
    [
        pytest.param(8110, 13, 31, id='sums of residuals'),
        pytest.param(8110, 91, 197, id='bits that touch'),
        pytest.param(10764, 637, 117, id='residuals of zones beside'),
        pytest.param(10922, 284, 9, id='wide sums'),
        pytest.param(10733, 178, 35, id='every other bit'),
        pytest.param(10770, 124, 37, id='the dimmer of two targets'),
        pytest.param(10775, 341, 17, id='sums of which a zone is erased'),
        pytest.param(10777, 77, 26, id='two packets that look like one, in a sum'),
        pytest.param(10958, 107, 32, id='expected packets, at no price'),
        pytest.param(10979, 253, 14, id='zone by zone'),
        pytest.param(11101, 30, 35, id='words of expected packets'),
    ],
)
def test_packets_of_a_random_room_are_read(seed: int, number: int, min_read: int) -> None:
    """By what each room is named for: without it, some are lost that are read with it."""
    scored = play(number, seed).scored
    assert sum(whole(scored)) >= min_read
    assert scored.wrong == []


def test_a_zone_without_a_marker_gives_no_range() -> None:
    """By light that is not known, which may look like a part of the marker's."""
    assert max(abs(one.error.range_m) for one in play(0, 10958).scored.placed) < 0.1


def test_a_range_is_unsure_if_no_zone_surely_sees_the_packet() -> None:
    """Such as one behind a hand, whose distance may be measured instead."""
    assert max(abs(one.range_deviations) for one in play(12, 10958).scored.placed) < 4


def test_the_range_of_a_marker_that_crosses_zones_is_sure() -> None:
    """By samples of dark bits, as the light of bright ones changes; the wall is far behind.

    Zones see it at other times, and it turns at the border of the view.
    """
    placed = []
    for number in range(3):
        rng = np.random.default_rng([11119, number])
        room = room_families.crossing(0.5, 40.0, rng)
        scene = replace(room.scene, surfaces=(Surface(2.5, WALL_SIGNAL),))
        placed += play_room(0, replace(room, scene=scene), rng).scored.placed
    assert len(placed) >= 90
    assert np.quantile([one.range_stddev_m for one in placed], 0.95) < 0.014
    assert np.median([abs(one.error.range_m) for one in placed]) < 0.004
    assert np.mean([abs(one.range_deviations) < 4 for one in placed]) > 0.85


def test_a_marker_of_another_code_is_not_read_again_and_again() -> None:
    """By the word test of two packets together."""
    assert len(play(37, 10782).scored.wrong) <= 3


@pytest.mark.parametrize(
    ('registered', 'half_s', 'most_s'), [(None, 1.18, 1.35), (16, 0.77, 0.88), (3, 0.66, 0.8)]
)
def test_ids_are_read_before_their_packets_are_whole(
    registered: int | None, half_s: float, most_s: float
) -> None:
    """By the search of what has appeared, less the first sample, with each bit, from any start."""
    first_s = []
    for number in range(20):
        rng = np.random.default_rng([79, 2, number])
        room = room_families.appearing(150.0, rng)
        time_s, wrong = room_families.first_id_s(room, registered, rng)
        first_s.append(time_s)
        assert wrong == 0
    assert np.median(first_s) < half_s
    assert np.quantile(first_s, 0.9) < most_s
