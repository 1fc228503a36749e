# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers that are followed in random rooms, in which all of ours repeat.

A marker is to be followed while it is there, once its ID was read, if its packets are bright enough
to be read. A track is false if no marker near it sends its ID, or did so just before.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from evaluation.bench.judging import Step, watch
from evaluation.bench.places import PlaceError, place_error
from evaluation.bench.room_markers import RoomMarker
from evaluation.bench.room_scene import RoomSimulation, draw_room
from evaluation.bench.room_truth import BRIGHT_DB, NEAR_ZONES, SentPacket, packets_of
from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.detection import Track
from retrolidar_ros.sensor.frame import Floats

_BEGUN_FRAMES = 5  # after it was read first
_ENDED_S = 0.3  # after its last packet


class RoomTracks(NamedTuple):
    """How markers are followed in a room."""

    frames: int  # to follow in, of all markers
    followed: int  # of these
    false: int  # frames of false tracks
    off: list[PlaceError]  # of each frame in which a marker is followed
    off_zones: list[float]  # the same in bearing
    deviations: list[float]  # the same in range, over the estimated deviation


def follow_room(number: int, seed: int) -> RoomTracks:
    """Draw a room of a seed, in which all markers of ours repeat, and follow them."""
    rng = np.random.default_rng([seed, number])
    room = draw_room(rng, all_repeat=True)
    simulation = RoomSimulation(room, rng)
    recording = simulation.run(room.scene.duration_s)
    detector = create_detector('joint', recording.grid, bit_period_s=room.bit_period_s)
    steps = list(watch(detector, recording, follow=True))
    sent, pitch = packets_of(simulation), recording.grid.pitch
    false = sum(
        not _is_true(one, room.markers, sent, pitch) for step in steps for one in step.tracks
    )
    result = RoomTracks(0, 0, false, [], [], [])
    for index, marker in enumerate(room.markers):
        own_db = [one.snr_db for one in sent if one.marker == index]
        if len(marker.ids) and own_db and np.mean(own_db) > BRIGHT_DB[0]:
            tracks = list(_tracks_of(marker, steps))
            seen = [one for one in tracks if one]
            for one in seen:
                error = place_error(one.place, _true_m(marker, one))
                result.off.append(error)
                result.off_zones.append(_off_zones(one, marker, pitch))
                result.deviations.append(error.range_m / one.place.range_stddev_m)
            result = result._replace(
                frames=result.frames + len(tracks), followed=result.followed + len(seen)
            )
    return result


def _tracks_of(marker: RoomMarker, steps: Sequence[Step]) -> Iterator[Track | None]:
    """Yield the track of a marker at each frame in which it is to be followed, or None."""
    id_, begins = int(marker.ids[0]), math.inf
    for number, step in enumerate(steps):
        if any(one.id == id_ for one in step.detections):
            begins = min(begins, number + _BEGUN_FRAMES)
        if (
            number > begins
            and marker.present_s[0] < 1e-9 * step.frame.stamp_ns < marker.present_s[1]
        ):
            yield next((one for one in step.tracks if one.id == id_), None)


def _is_true(
    track: Track, markers: Sequence[RoomMarker], sent: Sequence[SentPacket], pitch: float
) -> bool:
    time_s = 1e-9 * track.stamp_ns
    return any(
        one.id == track.id
        and one.start_s <= time_s <= one.end_s + _ENDED_S
        and _off_zones(track, markers[one.marker], pitch) < NEAR_ZONES
        for one in sent
    )


def _true_m(marker: RoomMarker, track: Track) -> Floats:
    """Return where a marker is at the frame of a track [m], shape (3,)."""
    position_m: Floats = marker.course.positions(np.array([1e-9 * track.stamp_ns]))[0]
    return position_m


def _off_zones(track: Track, marker: RoomMarker, pitch: float) -> float:
    """Return how far a track is from a marker in bearing, across or down [zones]."""
    (x, y, z), true_m = track.place.position_m, _true_m(marker, track)
    return float(np.abs([x / z, y / z] - true_m[:2] / true_m[2]).max() / pitch)
