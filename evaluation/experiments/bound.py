# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How near the search for a lone packet comes to a receiver that is told all but the word.

No test of acceptance: in a stretch of a few seconds there is one packet, and each receiver has to
name an ID. `told` knows start, clock, gain and offset, and takes the word of maximum likelihood.
`joint` knows nothing; of all candidates of its search, that of most evidence counts.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from evaluation.bench.link import Trial, link_scene, lone_trial
from evaluation.bench.rates import falls_below, rate
from evaluation.bench.sweep import told
from evaluation.bench.transmissions import transmission
from evaluation.report.charts import LEVEL, draw_shares, look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS, PACKET_BITS
from retrolidar_ros.scene.marker_budget import SNR, needed_swing
from retrolidar_ros.scene.reference import RESPONSE, WALL_SIGNAL

TITLE = 'The search against the bound'
SOURCE = ''

_SNRS_DB = (8.0, 7.0, 6.5, 6.0, 5.5, 5.0, 4.5, 4.0, 3.5, 3.0, 2.0)
_QUICK_SNRS_DB = (6.0, 3.0)
_SCENES, _QUICK_SCENES = 16, 2
_USABLE = np.arange(1, IDS - 1)
# So lax that the search hands on whatever stands out at all.
_FALSE_IDS_PER_HOUR = 1e6
_LOOKS = {'told': {'color': '0.35', 'marker': 'x', 'markersize': 5}, 'joint': look('joint')}


def joint_ids(trial: Trial) -> NDArray[np.int64]:
    """Return the ID of most evidence in each zone, 0 without any; shape (zones,)."""
    grid = trial.recording.grid
    detector = LikelihoodDetector(
        grid,
        bit_period_s=BIT_PERIOD_S,
        false_ids_per_hour=_FALSE_IDS_PER_HOUR,
        max_packets=MAX_PACKETS,
        registered_ids=None,
        noise=NoiseLaw(),
        sizes_m={},
    )
    detector.update_all(trial.recording)
    ids = np.zeros(grid.zones, dtype=np.int64)
    most = np.zeros(grid.zones)
    for candidate in detector.candidates:
        if candidate.zone < grid.zones and candidate.evidence > most[candidate.zone]:
            most[candidate.zone], ids[candidate.zone] = candidate.evidence, candidate.id
    return ids


def told_ids(trial: Trial, signal: float) -> NDArray[np.int64]:
    """Return the words of maximum likelihood when all else is known, shape (zones,)."""
    recording, noise = trial.recording, trial.scene.sensor.noise
    assert noise is not None
    half_s = trial.scene.sensor.period_s / 2
    nothing = np.zeros(len(_USABLE))
    ids = []
    for zone, marker in enumerate(trial.scene.markers):
        bit_s = marker.bit_period_s * (1 + marker.clock_error)
        since_s = recording.stamp_ns * 1e-9 - marker.start_s
        inside = (since_s > -half_s) & (since_s < (PACKET_BITS + 0.2) * bit_s + half_s)
        edges_s = np.append(since_s[inside] - half_s, since_s[inside][-1] + half_s)
        light = transmission(edges_s, _USABLE, nothing, np.full(len(_USABLE), bit_s), RESPONSE)
        level = WALL_SIGNAL + signal * light.T
        variance = noise.floor + noise.slope * level
        misfit = ((recording.signal[inside, zone] - level) ** 2 / variance + np.log(variance)).sum(
            axis=1
        )
        ids.append(int(_USABLE[misfit.argmin()]))
    return np.array(ids)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how often either receiver names the right ID, over the strength of the link."""
    snrs = _QUICK_SNRS_DB if quick else _SNRS_DB
    scenes = _QUICK_SCENES if quick else _SCENES
    shares: dict[str, list[Any]] = {'told': [], 'joint': []}
    for snr_db in tqdm(snrs, desc='bound', leave=False):
        hits = dict.fromkeys(shares, 0)
        trials = 0
        for _ in range(scenes):
            trial = lone_trial(link_scene(snr_db, rng), rng)
            own = np.array([marker.id for marker in trial.scene.markers])
            hits['told'] += int((told_ids(trial, needed_swing(snr_db)) == own).sum())
            hits['joint'] += int((joint_ids(trial) == own).sum())
            trials += len(own)
        for name, count in hits.items():
            shares[name].append(rate(count, trials))
    needed = {
        name: falls_below(LEVEL, snrs, [row['rate'] for row in rows])
        for name, rows in shares.items()
    }
    return {'snr_db': list(snrs), 'identified': shares, 'needed_db': needed}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = [f'{SNR} [dB]    told   joint']
    for index, snr_db in enumerate(figures['snr_db']):
        shares = (figures['identified'][name][index]['rate'] for name in ('told', 'joint'))
        lines.append(f'{snr_db:8.1f}  ' + '  '.join(f'{share:6.1%}' for share in shares))
    told_db, joint_db = (figures['needed_db'][name] for name in ('told', 'joint'))
    if told_db is not None and joint_db is not None:
        lines.append(
            f'{LEVEL:.0%} need {told_db:.1f} dB told all, {joint_db:.1f} dB told nothing: '
            f'{joint_db - told_db:.1f} dB more'
        )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the search beside a receiver that is told all but the word."""
    told_db, joint_db = (figures['needed_db'][name] for name in ('told', 'joint'))
    return [
        Claim(
            f'{SNR} that {LEVEL:.0%} need, no test of acceptance',
            default=f'{told(joint_db, "dB", 1)}; told all but the word {told(told_db, "dB", 1)}',
        )
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say what the bound is."""
    told_db, joint_db = (figures['needed_db'][name] for name in ('told', 'joint'))
    lost = None if told_db is None or joint_db is None else joint_db - told_db
    return (
        'A receiver of maximum likelihood that is told start, clock, gain and offset, and has only '
        f'the word to choose, is the bound for one packet. The search of `joint` needs '
        f'{told(lost, "dB", 1)} more, as it is told nothing. What it demands of a packet, so that '
        'false IDs stay away, costs what is between this and the SNR under `speed-accuracy`.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over the strength of the link."""
    figure, ((axes,),) = new_chart(1, 1, 8, 4.6)
    names = {'told': 'told start, clock, gain and offset', 'joint': 'joint, told nothing'}
    for name, rows in figures['identified'].items():
        draw_shares(axes, figures['snr_db'], rows, label=names[name], **_LOOKS[name])
    axes.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
    axes.set_xlabel(f'{SNR} [dB]')
    axes.set_ylabel('lone packets named rightly [%]')
    axes.set_ylim(0, 103)
    axes.set_title('No acceptance test: the search against the bound', fontsize=11)
    axes.legend(fontsize=9)
    figure.savefig(path)
