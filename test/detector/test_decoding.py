# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames become readings: grids, errors, and how many must agree before one is published."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from harness_frames import ID, a_scene, decoding, every_method, repeating, simulate

from retrolidar_ros.bag import BagError
from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.detection import Candidate, Detection
from retrolidar_ros.detector.parameters import DetectorSettings, defaults
from retrolidar_ros.sensor.frame import Frame, ZoneGrid


def frames(duration_s: float = 3.0, rows: int = 4) -> list[Frame]:
    scene = a_scene(position_m=(0.05, 0.04, 1.0), start_s=1.0)
    scene = replace(scene, sensor=replace(scene.sensor, grid=ZoneGrid(rows, rows)))
    return list(simulate(scene, duration_s))


@every_method
def test_another_zone_grid_begins_anew(method: str) -> None:
    assert list(decoding(method=method).detect([])) == []
    several = [*frames(), *frames(rows=8), *frames()]
    read = [detection.id for detection in decoding(method=method).detect(several)]
    assert read.count(ID) == 3


def test_all_frames_before_an_error_count() -> None:
    def damaged() -> Iterator[Frame]:
        # The packet has just ended: its last frames are in a block that is not full.
        yield from frames(1.0 + 31 * 0.042 + 0.05)
        raise BagError('cut off')

    detections = decoding().detect(damaged())
    assert next(detections).id == ID
    with pytest.raises(BagError, match='cut off'):
        next(detections)


@pytest.mark.filterwarnings('error')
def test_a_single_frame_is_said_to_be_too_few() -> None:
    alone = decoding()
    assert list(alone.detect(frames()[:1])) == []
    explanation = alone.explanation()
    assert list(map(str, explanation.findings())) == ['too few frames, 1: a packet takes 1.3 s']
    assert len(alone.table(explanation, [])) == 2  # its head, and the thresholds


def test_a_table_shows_the_best_of_what_was_rejected() -> None:
    scene = a_scene(start_s=0.0, packets=None, bit_period_s=0.0455)
    source, judging = list(simulate(scene, 6.0)), decoding()
    rejected: dict[int, list[Candidate]] = {}
    detector = DetectorSettings(defaults()).detector(source[0].grid)
    for frame in source:
        assert not detector.update(frame)
        for one in detector.candidates:
            rejected.setdefault(one.zone, []).append(one)
    assert not list(judging.detect(source))
    explanation = judging.explanation()
    rows = {int(row.split()[0]): row for row in judging.table(explanation, [])[1:-1]}
    several = [zone for zone in rows if len(rejected.get(zone, ())) > 1]
    assert several
    for zone in several:
        best = max(rejected[zone], key=lambda one: one.evidence)
        assert f' {best.id}  {best.evidence:8.1f}' in rows[zone]


FRAMES = list(repeating(6.0))
EVERY = list(decoding(min_readings=1).detect(FRAMES))


def reading(at_s: float, range_m: float = 1.0, identity: int = ID) -> Detection:
    place = replace(EVERY[0].place, range_m=range_m, range_stddev_m=0.002)
    stamp_ns = round(at_s * 1e9)
    return replace(EVERY[0], id=identity, stamp_ns=stamp_ns, end_ns=stamp_ns, place=place)


@pytest.mark.parametrize('min_readings', [1, 2, 3, 20])
def test_first_readings_are_withheld_and_whoever_has_no_more_is_told(min_readings: int) -> None:
    withholding = decoding(min_readings=min_readings)
    stamps_ns = [one.stamp_ns for one in withholding.detect(FRAMES)]
    assert stamps_ns == [one.stamp_ns for one in EVERY[min_readings - 1 :]]
    why = [str(one) for one in withholding.explanation().findings()]
    withheld = f'withheld: fewer agree than min_readings, {min_readings}'
    assert [withheld in one for one in why] == [True] * (min_readings > len(EVERY))


@pytest.mark.parametrize(
    ('second', 'agrees'),
    [
        (reading(1.3), True),
        (reading(1.3, 1.5), True),  # it comes nearer, or goes
        (reading(1.3, 2.5), False),
        (reading(0.0, 1.05), False),
        (reading(0.0), False),  # the same again, of a bag that is played twice
        (reading(0.6), False),  # most of the same packet
        (reading(15.0), True),  # read in few of its packets
        (reading(17.0), False),
        (reading(1.3, identity=2096), False),
        (reading(-1e4), False),  # the clock was set back
    ],
)
def test_two_readings_agree_in_id_time_and_range(second: Detection, agrees: bool) -> None:
    agreement = Agreement(2)
    assert agreement.confirmed([reading(0.0)]) == []
    assert agreement.confirmed([second]) == ([second] if agrees else [])
    assert (agreement.passed, agreement.withheld) == (agrees, 2 - agrees)


def test_a_reading_from_before_time_was_set_back_lets_no_track_pass() -> None:
    agreement = Agreement(2)
    before = [reading(100.0), reading(101.3)]
    assert agreement.confirmed(before) == before[1:]
    track = next(iter(decoding().follow(FRAMES)))
    now = replace(track, id=before[1].id, first_ns=5_000_000_000, stamp_ns=6_000_000_000)
    assert agreement.followed([now]) == []
    later = replace(now, stamp_ns=before[1].end_ns)
    assert agreement.followed([later]) == [later]


def test_a_marker_is_followed_once_a_reading_of_it_was_passed_on() -> None:
    first, later = (list(decoding(min_readings=count).follow(FRAMES)) for count in (1, 2))
    assert later
    assert min(one.stamp_ns for one in later) >= EVERY[1].end_ns
    assert min(one.stamp_ns for one in first) < EVERY[1].end_ns
