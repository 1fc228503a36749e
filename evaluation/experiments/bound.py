# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How near the search for a lone packet comes to a receiver that knows all but the word.

No test of acceptance: in a stretch of a few seconds there is one packet, and each receiver has to
name an ID. `told` knows start, clock, gain and offset, and takes the word of maximum likelihood.
`joint` knows nothing; of all candidates of its search, that of most evidence counts.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from evaluation.bench.judging import BOTH, judged, new_detector
from evaluation.bench.rates import crossing, rate
from evaluation.bench.recordings import Sent, record, signal_at, snr_db
from evaluation.bench.stresses import PLAIN
from evaluation.bench.transmissions import transmission
from evaluation.report.charts import LEVEL, draw_shares, look, new_chart
from evaluation.report.claims import Table, as_text
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.marker_budget import SNR
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR, WALL_SIGNAL

TITLE = 'The search against the bound'
MESSAGE = 'What the search is not told costs more than its tests of acceptance'
RANGES_M = (2.5, 2.7, 2.8, 2.9, 3.0, 3.1, 3.2, 3.3, 3.5, 3.8)
_RECORDINGS, _QUICK_RECORDINGS = 6, 1
# So lax that the search hands on whatever stands out at all.
_LAX = {'method': 'joint', 'false_ids_per_hour': 1e6}
_NAMES = {
    'told': 'told start, clock, gain and offset',
    'searched': 'the search of the default, told nothing',
    'accepted': 'the default, with its tests of acceptance',
}


def searched_ids(sent: Sent) -> NDArray[np.int64]:
    """Return the ID of most evidence in each zone, 0 without any; shape (zones,)."""
    zones = sent.recording.grid.zones
    detector = new_detector(sent.recording.grid, _LAX)
    assert isinstance(detector, LikelihoodDetector)
    detector.update_all(sent.recording)
    ids = np.zeros(zones, dtype=np.int64)
    most = np.zeros(zones)
    for candidate in detector.candidates:
        if candidate.zone < zones and candidate.evidence > most[candidate.zone]:
            most[candidate.zone], ids[candidate.zone] = candidate.evidence, candidate.id
    return ids


def told_ids(sent: Sent, signal: float) -> NDArray[np.int64]:
    """Return the words of maximum likelihood when all else is known, shape (zones,)."""
    recording, half_s = sent.recording, SENSOR.period_s / 2
    nothing = np.zeros(len(USABLE_IDS))
    ids = []
    for zone, start_s in enumerate(sent.start_s):
        since_s = recording.stamp_ns * 1e-9 - start_s
        end_s = (PACKET_BITS + 0.2) * BIT_PERIOD_S + half_s
        inside = (since_s > -half_s) & (since_s < end_s)
        edges_s = np.append(since_s[inside] - half_s, since_s[inside][-1] + half_s)
        bits_s = np.full(len(USABLE_IDS), BIT_PERIOD_S)
        light = transmission(edges_s, USABLE_IDS, nothing, bits_s, RESPONSE)
        level = WALL_SIGNAL + signal * light.T
        variance = NOISE.floor + NOISE.slope * level
        misfit = (recording.signal[inside, zone] - level) ** 2 / variance + np.log(variance)
        ids.append(int(USABLE_IDS[misfit.sum(axis=1).argmin()]))
    return np.array(ids)


def told_reach(recordings: int, rng: np.random.Generator) -> float | None:
    """Return to where four of five words are named rightly if all else is known [m]."""
    rates = []
    for range_m in RANGES_M:
        signal = signal_at(range_m)
        sent = [record(PLAIN, signal, rng, USABLE_IDS) for _ in range(recordings)]
        hits = sum(int((told_ids(one, signal) == one.ids).sum()) for one in sent)
        rates.append(rate(hits, sum(len(one.ids) for one in sent)))
    return crossing(LEVEL, RANGES_M, rates)['at']


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how often each receiver names the right ID, over distance."""
    ranges_m = RANGES_M[::3] if quick else RANGES_M
    recordings = _QUICK_RECORDINGS if quick else _RECORDINGS
    shares: dict[str, list[Any]] = {name: [] for name in _NAMES}
    for range_m in tqdm(ranges_m, desc='bound', leave=False):
        hits, trials = dict.fromkeys(_NAMES, 0), 0
        signal = signal_at(range_m)
        for _ in range(recordings):
            sent = record(PLAIN, signal, rng, USABLE_IDS)
            hits['told'] += int((told_ids(sent, signal) == sent.ids).sum())
            hits['searched'] += int((searched_ids(sent) == sent.ids).sum())
            hits['accepted'] += int(judged(sent, BOTH['joint']).right.sum())
            trials += len(sent.ids)
        for name, count in hits.items():
            shares[name].append(rate(count, trials))
    ends = {name: crossing(LEVEL, ranges_m, rows) for name, rows in shares.items()}
    return {
        'ranges_m': list(ranges_m),
        'snr_db': [snr_db(signal_at(range_m)) for range_m in ranges_m],
        'identified': shares,
        'ends': ends,
        'needed_db': {
            name: None if end['at'] is None else snr_db(signal_at(end['at']))
            for name, end in ends.items()
        },
    }


def table(figures: dict[str, Any]) -> Table:
    """Return to where each receiver names four of five rightly, and the link that it needs."""
    return [
        ['receiver', '80 % are named rightly to', f'which is {SNR}'],
        *(
            [_NAMES[name], as_text(end['at']), as_text(figures['needed_db'][name], 'dB', 1)]
            for name, end in figures['ends'].items()
        ),
    ]


def draw(figures: dict[str, Any]) -> Any:
    """Draw identification over distance."""
    figure, ((axes,),) = new_chart(1, 1, 9, 5.2, MESSAGE)
    looks = {
        'told': look('told'),
        'searched': look('joint') | {'linestyle': ':'},
        'accepted': look('joint'),
    }
    for name, rows in figures['identified'].items():
        draw_shares(axes, figures['ranges_m'], rows, label=_NAMES[name], **looks[name])
    axes.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
    axes.set_xlabel('distance of a marker of 3 cm [m]')
    axes.set_ylabel('lone packets named rightly [%]')
    axes.set_ylim(0, 103)
    axes.legend(fontsize=11, loc='lower left')
    return figure
