# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How near the search for a lone packet comes to a receiver that is told all but the word.

No test of acceptance: in a stretch of a few seconds there is one packet, and each receiver has to
name an ID. `told` knows start, clock, gain and offset, and takes the word of maximum likelihood.
`joint` knows nothing; it looks at every start and takes what explains the samples best.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from retrolidar_ros.code import BIT_PERIOD_S, IDS, packet
from retrolidar_ros.detector.evidence import nats
from retrolidar_ros.detector.search import Demand, JointSearch
from retrolidar_ros.detector.starts import EIGHTHS
from retrolidar_ros.detector.template import packet_light
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.window import SampleWindow
from retrolidar_ros.detector.words import WordBank
from retrolidar_ros.evaluation.charts import LEVEL, draw_shares, look, new_chart
from retrolidar_ros.evaluation.claims import Claim
from retrolidar_ros.evaluation.link import SNR, Trial, amplitude, link_scene, lone_trial
from retrolidar_ros.evaluation.reference import WALL_SIGNAL
from retrolidar_ros.evaluation.statistics import falls_below, rate
from retrolidar_ros.evaluation.sweep import told

TITLE = 'The search against the bound'
SOURCE = ''

_SNRS_DB = (8.0, 7.0, 6.5, 6.0, 5.5, 5.0, 4.5, 4.0, 3.5, 3.0, 2.0)
_QUICK_SNRS_DB = (6.0, 3.0)
_SCENES, _QUICK_SCENES = 16, 2
_USABLE = np.arange(1, IDS - 1)
_ENDS_AT_ONCE = 64
_LOOKS = {'told': {'color': '0.35', 'marker': 'x', 'markersize': 5}, 'joint': look('joint')}


def view_of(trial: Trial) -> View:
    """Return all zones over all the time of a trial."""
    recording = trial.recording
    zones = recording.grid.zones
    window = SampleWindow(zones, len(recording), BIT_PERIOD_S)
    # Times count from the scene's own beginning.
    window.append(recording.stamp_ns, recording.signal, recording.distance, recording.status)
    return View.of(window.last(len(recording)), np.arange(zones))


def joint_ids(view: View, search: JointSearch) -> NDArray[np.int64]:
    """Return the ID that explains each zone best, wherever its packet ends, shape (zones,)."""
    zones = len(view.zones)
    step_s = BIT_PERIOD_S / EIGHTHS
    ends_s = np.arange(view.begin_s[0] + 48 * BIT_PERIOD_S, view.end_s[-1], step_s)
    demand = Demand(0.0, np.ones(zones))
    ids = np.zeros(zones, dtype=np.int64)
    most = np.zeros(zones)
    for first in range(0, len(ends_s), _ENDS_AT_ONCE):
        some = ends_s[first : first + _ENDS_AT_ONCE]
        found = search.ended(view, some, np.ones((len(some), zones), dtype=bool), demand)
        if found is None:
            continue
        evidence = nats(found.correlation, 2 * (found.end_s - found.begin_s) / found.bit_s)
        for zone, identity, gained in zip(found.zone, found.ids, evidence, strict=True):
            if gained > most[zone]:
                most[zone], ids[zone] = gained, identity
    return ids


def told_ids(trial: Trial, view: View, signal: float) -> NDArray[np.int64]:
    """Return the words of maximum likelihood when all else is known, shape (zones,)."""
    bits = packet(_USABLE)
    ids = []
    for zone, marker in enumerate(trial.scene.markers):
        bit_s = marker.bit_period_s * (1 + marker.clock_error)
        inside = (view.end_s > marker.start_s) & (view.begin_s < marker.start_s + 31.2 * bit_s)
        light = packet_light(
            bits,
            np.full(len(bits), marker.start_s),
            np.full(len(bits), bit_s),
            np.zeros(len(bits), dtype=bool),
            view.begin_s[inside],
            view.end_s[inside],
        ).mean
        noise = trial.scene.sensor.noise
        assert noise is not None
        level = WALL_SIGNAL + signal * light
        variance = noise.floor + noise.slope * level
        misfit = ((view.signal[inside, zone] - level) ** 2 / variance + np.log(variance)).sum(
            axis=1
        )
        ids.append(int(_USABLE[misfit.argmin()]))
    return np.array(ids)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how often either receiver names the right ID, over the strength of the link."""
    snrs = _QUICK_SNRS_DB if quick else _SNRS_DB
    scenes = _QUICK_SCENES if quick else _SCENES
    search = JointSearch(WordBank(), BIT_PERIOD_S)
    shares: dict[str, list[Any]] = {'told': [], 'joint': []}
    for snr_db in tqdm(snrs, desc='bound', leave=False):
        hits = dict.fromkeys(shares, 0)
        trials = 0
        for _ in range(scenes):
            trial = lone_trial(link_scene(snr_db, rng), rng)
            view = view_of(trial)
            own = np.array([marker.id for marker in trial.scene.markers])
            hits['told'] += int((told_ids(trial, view, amplitude(snr_db)) == own).sum())
            hits['joint'] += int((joint_ids(view, search) == own).sum())
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
        f'{told(lost, "dB", 1)} more, as it is told nothing. The tests that keep false IDs away '
        'cost what is between this and the SNR under `speed-accuracy`.'
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
