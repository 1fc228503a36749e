# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What must hold of a detector, its readings and its tracks, whatever frames they are given."""

from typing import Any

import numpy as np
from cffi import FFI
from harness_core import KEPT
from numpy.typing import NDArray

from retrolidar_ros.marker.code import IDS, PACKET_BITS


def check(
    ffi: FFI, lib: Any, detector: Any, settings: dict[str, Any], ids: NDArray[np.uint16]
) -> None:
    """Check what must hold of a detector, whatever it is given."""
    rows, most_packets = settings['rows'], settings['max_packets']
    zones = rows * rows
    sources = sum(side**2 for side in range(rows, rows - 4, -1))  # squares of 1 to 4 zones
    counts, held = lib.rl_detector_counts(detector), lib.rl_detector_held(detector)
    assert counts.accepted + sum(counts.rejected) == counts.candidates
    assert (held.zones, held.channels) == (zones, sources)
    assert 0 <= held.first <= held.count <= 4 * KEPT
    assert 0 < held.period_s < np.inf

    def values(array: Any, columns: int, kind: str) -> NDArray[Any]:
        size = columns * held.capacity * np.dtype(kind).itemsize
        all_rows = np.frombuffer(ffi.buffer(array, size), kind).reshape(columns, -1)
        return all_rows[:, held.first : held.count]

    (begin_s,), (end_s,) = (values(one, 1, 'f8') for one in (held.begin_s, held.end_s))
    assert np.isfinite(begin_s).all()
    assert (begin_s < end_s).all()
    assert (end_s[:-1] <= begin_s[1:]).all()
    signal, distance = values(held.signal, sources, 'f4'), values(held.distance, zones, 'f4')
    assert (np.isfinite(signal) & (signal >= 0)).all()
    assert (np.isnan(distance) | ((distance > 0) & (distance < 8.192))).all()
    newest = lib.rl_detector_newest(detector)
    for one in newest.candidate[0 : newest.candidates]:
        assert 0 <= one.reason <= lib.RL_READ
        assert 0 <= one.channel < sources
        assert 1 <= one.packets <= most_packets
        assert abs(one.bit_s / settings['bit_s'] - 1) < 0.05
        assert np.isfinite([one.start_s, one.evidence, one.margin]).all()
        assert np.isfinite(one.word) or one.word == -np.inf
    for one in newest.reading[0 : newest.readings]:
        assert one.id in ids if len(ids) else 0 < one.id < IDS - 1
        assert 1 <= one.packets <= most_packets
        assert abs(one.bit_s / settings['bit_s'] - 1) < 0.05
        assert np.isfinite([one.start_s, one.begin_s, one.end_s, one.evidence, one.margin]).all()
        assert one.begin_s < one.end_s
        assert one.evidence >= settings['demands']['evidence']
        assert 1 <= one.zones <= 16
        assert all(0 <= zone < zones for zone in one.zone[0 : one.zones])


def check_places(lib: Any, detector: Any) -> None:
    """Check what must hold of the place of every reading."""
    newest = lib.rl_detector_newest(detector)
    for one in newest.reading[0 : newest.readings]:
        if not one.is_placed:
            continue
        placed = one.placement
        assert 0 < placed.range_m < 20
        assert 0 < placed.range_variance < np.inf
        assert np.isfinite(placed.amplitude)
        assert one.begin_s - 1 < placed.time_s < one.end_s + 1
        assert placed.noise > 0
        assert placed.likelihood >= 0
        assert 0 <= placed.score < 1 + 1e-9
        assert 0 <= placed.corrected_bits <= PACKET_BITS
        assert 1 <= placed.zones <= lib.RL_MAX_READ
        assert np.abs(list(placed.bearing.mean)).max() < 0.7 + 1e-9
        assert all(0 <= variance < 0.49 for variance in placed.bearing.variance)


def follow_all(lib: Any, tracks: Any) -> None:
    """Check what must hold of tracks, whatever frames they are followed in."""
    count = lib.rl_tracks_follow(tracks)
    counts = lib.rl_tracks_counts(tracks)
    assert 0 <= count <= lib.RL_MAX_TRACKS
    assert counts.started - counts.ended - counts.dropped == count
    for index in range(count):
        one = lib.rl_tracks_track(tracks, index)
        assert 0 < one.range_m < 100
        assert 0 < one.range_variance < np.inf
        assert np.isfinite([one.range_rate, one.first_s]).all()
        assert 0 < one.range_rate_variance < np.inf
        assert 0 < one.log_odds < np.inf
        assert np.isfinite([*one.tangent]).all()
        assert all(0 <= variance < np.inf for variance in one.tangent_variance)
