# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers that are followed in random rooms, in which all of ours repeat.

A marker is to be followed while it is there, once its ID was read, if its packets are bright enough
to be read. A track is false if no marker near it sends its ID, or did so just before.
"""

import math
from collections import Counter
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


class Followed(NamedTuple):
    """How a marker is followed."""

    motion: str
    company: str  # of most of its packets
    frames: int  # to follow it in
    off: list[PlaceError]  # of each frame in which it is followed
    off_zones: list[float]  # the same in bearing


class RoomTracks(NamedTuple):
    """How markers are followed in a room."""

    markers: list[Followed]
    places: int  # of all tracks, one in each frame
    false: int  # of these


def follow_room(number: int, seed: int) -> RoomTracks:
    """Draw a room of a seed, in which all markers of ours repeat, and follow them."""
    rng = np.random.default_rng([seed, number])
    room = draw_room(rng, all_repeat=True)
    simulation = RoomSimulation(room, rng)
    recording = simulation.run(room.scene.duration_s)
    detector = create_detector('joint', recording.grid, bit_period_s=room.bit_period_s)
    steps = list(watch(detector, recording, follow=True))
    sent, pitch = packets_of(simulation), recording.grid.pitch
    true = [_is_true(one, room.markers, sent, pitch) for step in steps for one in step.tracks]
    markers = []
    for index, marker in enumerate(room.markers):
        own = [one for one in sent if one.marker == index]
        if not len(marker.ids) or not own or np.mean([one.snr_db for one in own]) < BRIGHT_DB[0]:
            continue
        company, _ = Counter(one.company for one in own).most_common(1)[0]
        tracks = list(_tracks_of(marker, steps))
        seen = [one for one in tracks if one]
        off = [place_error(one.place, _true_m(marker, one)) for one in seen]
        off_zones = [_off_zones(one, marker, pitch) for one in seen]
        markers.append(Followed(marker.course.motion, company, len(tracks), off, off_zones))
    return RoomTracks(markers, len(true), true.count(False))


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
