# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The search for a lone packet against a receiver that knows all but the word.

There is one packet in a few seconds, and each receiver has to name an ID: nothing is rejected.
`genie` knows start, clock, gain and offset, and takes the word of maximum likelihood. The search of
`joint` knows none of these; its candidate of most evidence counts.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.judging import BOTH, judged, read_of
from evaluation.bench.rates import LEVEL, Rate, crossing, rate
from evaluation.bench.recordings import Sent, signal_at, snr_db
from evaluation.experiments.paper_sweeps import lone_packets
from evaluation.report.chart_style import draw_shares, label, legend_below, look, new_chart
from evaluation.report.claims import Table, as_text
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.transmission import exposure_edges, transmitted
from retrolidar_ros.sensor.frame import Floats

TITLE = 'The search against the bound'
RANGES_M = (2.5, 2.7, 2.8, 2.9, 3.0, 3.1, 3.2, 3.3, 3.5, 3.8)
_LAX = 1e6  # false IDs an hour: with these, the search returns every candidate
_NAMES = {
    'genie': 'ideal receiver (knows start, clock, gain, offset)',
    'searched': 'the search of the default, which knows none of them',
    'accepted': 'the default, with its tests of acceptance',
}
_GENIE_RECORDINGS = 4  # to try all words takes long
_PHASES = 64  # of a packet's start within a frame, for which templates are kept
_FRAMES = round(PACKET_BITS * BIT_PERIOD_S / SENSOR.period_s) + 2


def searched_ids(sent: Sent) -> NDArray[np.int64]:
    """Return the ID of most evidence in each zone, 0 without any; shape (zones,)."""
    zones = sent.recording.grid.zones
    detector = create_detector('joint', sent.recording.grid, false_ids_per_hour=_LAX)
    detector.update_all(sent.recording)
    ids = np.zeros(zones, dtype=np.int64)
    max_evidence = np.zeros(zones)
    for candidate in detector.candidates:
        if candidate.zone < zones and candidate.evidence > max_evidence[candidate.zone]:
            max_evidence[candidate.zone], ids[candidate.zone] = candidate.evidence, candidate.id
    return ids


@lru_cache(_PHASES + 1)
def _templates(phase: int) -> Floats:
    """Return the light of all words from a phase of a frame on, shape (frames, words)."""
    middle_s = SENSOR.period_s * (np.arange(_FRAMES) + 0.5 - phase / _PHASES)
    levels = np.column_stack([1.0 - packet(USABLE_IDS), np.ones(len(USABLE_IDS))]).T
    begin_s = BIT_PERIOD_S * np.arange(len(levels))
    return transmitted(begin_s, levels, RESPONSE, exposure_edges(middle_s, SENSOR.period_s))


def genie_ids(sent: Sent, signal: float) -> NDArray[np.int64]:
    """Return the words of maximum likelihood when all else is known, shape (zones,)."""
    period_s, begin_s = SENSOR.period_s, sent.recording.stamp_ns * 1e-9 - SENSOR.period_s / 2
    ids = []
    for zone, start_s in enumerate(sent.start_s):
        first = int(np.searchsorted(begin_s, start_s, side='right')) - 1
        light = _templates(round((start_s - begin_s[first]) / period_s * _PHASES))
        level = WALL_SIGNAL + signal * light
        variance = NOISE.floor + NOISE.slope * level
        samples = sent.recording.signal[first : first + _FRAMES, zone, None]
        misfit = (samples - level) ** 2 / variance + np.log(variance)
        ids.append(int(USABLE_IDS[misfit.sum(axis=0).argmin()]))
    return np.array(ids)


def _named(sent: Sequence[Sent], receiver: Callable[[Sent], NDArray[np.int64]]) -> Rate:
    right = [receiver(one) == one.ids for one in sent]
    return rate(int(np.sum(right)), int(np.size(right)))


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how often each receiver names the right ID, over distance."""
    seed, ranges_m = int(rng.integers(2**31)), RANGES_M[::3] if quick else RANGES_M
    shares: dict[str, list[Rate]] = {name: [] for name in _NAMES}
    for range_m in ranges_m:
        sent = lone_packets(range_m, seed, quick=quick)
        few, genie = sent[:_GENIE_RECORDINGS], partial(genie_ids, signal=signal_at(range_m))
        shares['genie'].append(_named(few, genie))
        shares['searched'].append(_named(few, searched_ids))
        shares['accepted'].append(read_of([judged(one, BOTH['joint']) for one in sent])['right'])
    ends = {name: crossing(LEVEL, ranges_m, rows) for name, rows in shares.items()}
    return {'ranges_m': list(ranges_m), 'identified': shares, 'ends': ends}


def table(figures: dict[str, Any]) -> Table:
    """Return to where each receiver names four of five rightly, and the link that it needs."""
    rows = [['receiver', '80 % are named rightly to', 'signal over noise']]
    for name, end in figures['ends'].items():
        needed = None if end['at'] is None else snr_db(signal_at(end['at']))
        rows.append([_NAMES[name], as_text(end['at']), as_text(needed, 'dB', 1)])
    return rows


def _message(figures: dict[str, Any]) -> str:
    genie, searched, accepted = (figures['ends'][name]['at'] for name in _NAMES)
    if None in (genie, searched, accepted):
        return 'What the search and its tests cost'
    # Of the rounded ends in the table, so that they agree.
    genie, searched, accepted = (round(100 * one) for one in (genie, searched, accepted))
    known, tests = (f'{lost} cm' for lost in (genie - searched, searched - accepted))
    return f'The search for start, clock, gain and offset costs {known} of reach, the tests {tests}'


def draw(figures: dict[str, Any]) -> Any:
    """Draw identification over distance."""
    figure, (axis,) = new_chart(1, 1, 5, _message(figures))
    looks = {
        'genie': look('genie'),
        'searched': look('joint') | {'linestyle': ':'},
        'accepted': look('joint'),
    }
    for name, rows in figures['identified'].items():
        draw_shares(axis, figures['ranges_m'], rows, **looks[name])
    axis.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
    x, y = 'distance of a marker of 3 cm [m]', 'lone packets named rightly [%]'
    label(axis, x, y, percent=True)
    legend_below(figure, (), {_NAMES[name]: how for name, how in looks.items()})
    return figure
