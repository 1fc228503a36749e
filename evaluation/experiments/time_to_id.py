# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long it takes until a repeating marker that comes into view is identified."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.judging import BOTH, Options, judged
from evaluation.bench.rates import LEVEL, nearest
from evaluation.bench.recordings import SILENCE_BITS, Sent, dark, record_at
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.visual_markers import APRILTAG, AprilTagReader, read_over_distance
from evaluation.report.chart_style import draw_level, label, line, look, name_curve, new_chart
from evaluation.report.claims import as_text
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, PACKET_S, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS

TITLE = 'Time to the first ID'
TIMEOUT_S = 8 * PACKET_S
VIEW_S = SILENCE_BITS * BIT_PERIOD_S  # when the markers come into view
SHARES = (0.5, LEVEL)
REGISTERED, FEW = 'registered', 3  # IDs that are registered, of markers that come together
_MENDED_BITS, _SETS = 1, 300  # bits that noise may turn; sets of IDs that are drawn
_RANGES_M = (0.5, 0.75, 1.0, 1.5, 2.0, 2.4, 2.8, 3.2, 3.6, 4.0)
_WORDS = {
    'joint': 'LiDAR, any of 4094 IDs',
    REGISTERED: f'LiDAR, {FEW} registered IDs',
    'paper': "LiDAR, paper's method, our code",
    APRILTAG: 'AprilTag, 30 pictures a second',
}
_NAMES = (REGISTERED, *METHODS, APRILTAG)
_NEVER = f'>{TIMEOUT_S:.0f} s'


def appearing(range_m: float, rng: np.random.Generator) -> Sent:
    """Return markers that have always been sending and come into view at `VIEW_S`."""
    sent = record_at(range_m, rng, repeated_s=VIEW_S + TIMEOUT_S)
    return dark(sent, sent.recording.stamp_ns[:, None] < VIEW_S * 1e9, rng)


def first_ids(sent: Sent, options: Options) -> tuple[NDArray[np.float64], int]:
    """Return the time from view to the first right ID of each zone, and how many IDs were wrong.

    The times are in seconds, infinite where there was no right ID, shape (zones,).
    """
    times_s = np.full(len(sent.ids), math.inf)
    found = judged(sent, options, lone=False)
    for one in found.own:
        zone = next(zone for zone in one.zones if sent.ids[zone] == one.id)
        times_s[zone] = min(times_s[zone], one.end_ns * 1e-9 - VIEW_S)
    return times_s, found.readings - len(found.own)


def _few_first_ids(sent: Sent, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the times of markers of which `FEW` at a time are in view, and registered [s]."""
    zones, times_s = rng.permutation(len(sent.ids)), []
    for few in zones[: len(zones) // FEW * FEW].reshape(-1, FEW):
        alone = dark(sent, ~np.isin(np.arange(len(sent.ids)), few), rng)
        found_s, _ = first_ids(alone, {**BOTH['joint'], 'registered_ids': sent.ids[few]})
        times_s.append(found_s[few])
    return np.concatenate(times_s)


def needed_bits(ids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return after how many bits the first of some IDs differs from the others, by its start.

    A marker repeats, and is seen from any of its bits on, shape (31,). Another ID is excluded when
    it differs in more than `_MENDED_BITS`, wherever it starts.
    """
    # Each packet from each of its bits on, and so on round it; shape (ids, starts, bits).
    turns = (np.arange(PACKET_BITS)[:, None] + np.arange(PACKET_BITS)) % PACKET_BITS
    words = packet(ids)[:, turns]
    differing = words[0][:, None] != words[1:].reshape(-1, PACKET_BITS)
    excluded = (np.cumsum(differing, axis=2) > _MENDED_BITS).all(axis=1)
    needed: NDArray[np.int64] = PACKET_BITS - excluded.sum(axis=1) + 1
    return needed


def _min_s(rng: np.random.Generator) -> float:
    """Return the time by which `FEW` registered IDs differ enough, for four of five starts [s]."""
    sets = (rng.choice(USABLE_IDS, FEW, replace=False) for _ in range(_SETS))
    bits = np.concatenate([needed_bits(ids) for ids in sets])
    return float(np.quantile(bits, LEVEL)) * BIT_PERIOD_S


def time_by_which(share: float, times_s: NDArray[np.float64]) -> float | None:
    """Return the time by which a share of all has been identified; None = never."""
    time_s = float(np.sort(times_s)[math.ceil(share * len(times_s)) - 1])
    return time_s if math.isfinite(time_s) else None


def _by_pictures(share: float, read: float) -> float | None:
    """Return the time by which a share is read, of pictures that are independent of each other."""
    if read <= 0:
        return None
    pictures = 1 if read >= share else math.ceil(math.log(1 - share) / math.log(1 - read))
    time_s = pictures / PICTURES_HZ
    return time_s if time_s <= TIMEOUT_S else None


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return times to the first right ID over distance."""
    ranges_m, points = _RANGES_M[:: 3 if quick else 1], []
    seed = int(rng.integers(2**31))
    pictures = read_over_distance([AprilTagReader()], ranges_m, seed, quick=quick)
    for range_m, found in zip(ranges_m, pictures, strict=True):
        sent = [appearing(range_m, rng) for _ in range(1 if quick else 3)]
        times_s: dict[str, list[NDArray[np.float64]]] = {
            REGISTERED: [_few_first_ids(one, rng) for one in sent],
            **{method: [first_ids(one, BOTH[method])[0] for one in sent] for method in METHODS},
        }
        point: dict[str, Any] = {'range_m': range_m}
        for name, rows in times_s.items():
            point[name] = [time_by_which(share, np.concatenate(rows)) for share in SHARES]
        read = found[APRILTAG]['right']['rate']
        point[APRILTAG] = [_by_pictures(share, read) for share in SHARES]
        points.append(point)
    return {'points': points, 'least_s': _min_s(rng)}


def at(figures: dict[str, Any], name: str, range_m: float) -> str:
    """Return the time by which four of five are identified at a distance, as text."""
    point = nearest(figures['points'], 'range_m', range_m)
    time_s = point[name][-1]
    return _NEVER if time_s is None else as_text(time_s, 's', 2 if time_s < LEVEL else 1)


def _message(figures: dict[str, Any]) -> str:
    def ends(name: str) -> str:
        times_s = [one[name][-1] for one in figures['points'] if one[name][-1]]
        return f'{times_s[0]:.2g} to {max(times_s):.2g} s' if times_s else 'nothing'

    message = f'To read farther, wait longer: a LiDAR marker takes {ends("joint")}'
    return f'{message}, a tag {ends(APRILTAG)}'


def draw(figures: dict[str, Any]) -> Any:
    """Draw the times by which four of five are identified, over distance."""
    figure, (axis,) = new_chart(1, 1, 4.8, _message(figures))
    ranges_m = [one['range_m'] for one in figures['points']]
    for index, name in enumerate(_NAMES, start=1):
        times_s = np.array([one[name][-1] for one in figures['points']], dtype=float)
        known = np.flatnonzero(np.isfinite(times_s))
        axis.plot(ranges_m, times_s, **look(name))
        late_s = np.where(np.isfinite(times_s), np.nan, TIMEOUT_S * 1.24**index)
        axis.plot(ranges_m, late_s, **look(name) | {'fillstyle': 'none', 'linestyle': ''})
        if len(known):
            at, times = known[len(known) // 3], 1.3 if name in ('joint', 'paper') else 0.75
            name_curve(axis, name, _WORDS[name], (ranges_m[at], times * times_s[at]))
    for time_s, words in ((PACKET_S, 'one packet'), (TIMEOUT_S, 'hollow: not in 8 packets')):
        draw_level(axis, time_s, words, 0.91, **line(':', '0.5'))
    words = f'fewest bits that tell {FEW} IDs apart'
    draw_level(axis, figures['least_s'], words, **line('--', look(REGISTERED)['color']))
    x, y = 'distance of a marker of 3 cm [m]', 'time until 80 % are identified [s]'
    ends = (0.02, 3 * TIMEOUT_S)
    label(axis, x, y, yscale='log', ylim=ends, yticks=(0.03, 0.1, 0.3, 1.0, 3.0, 10.0))
    return figure
