# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is read where a marker sends nothing, and where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.rates import frequency, rate
from evaluation.bench.restless import restless_blocks
from evaluation.experiments.link_budget import NEVER_S
from evaluation.report.charts import look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.detector.budget import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.scene.truth import PACKET_S
from retrolidar_ros.sensor.frame import Recording

TITLE = 'False alarms'
SOURCE = 'paper §6.2, Fig. 8c'
PAPER_FALSE_DETECTIONS = 0.005
_RANGES_M = (1.0, 1.4, 1.8, 2.2, 2.6)
_HOURS, _QUICK_HOURS = 0.25, 0.002
_RESTLESS_SHARE = 0.2  # of the hours: much happens there
ZONES = SENSOR.grid.zones


def _blocks(scene: str, range_m: float, hours: float, rng: np.random.Generator) -> list[Recording]:
    """Return the frames of markers that never send, of the bare wall, or of moving hands."""
    if scene == 'moving hands':
        return list(restless_blocks(hours * 3600, rng))
    still = marker_in_each_zone(range_m, rng, start_s=(NEVER_S, NEVER_S))
    if scene == 'bare wall':
        still = replace(still, markers=())
    return list(Simulation(still, rng).blocks(hours * 3600))


def _watch(
    scene: str, range_m: float | None, hours: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Count what both methods read in the same frames."""
    blocks = _blocks(scene, range_m or max(_RANGES_M), hours, rng)
    looks = max(1, round(hours * 3600 / PACKET_S)) * ZONES
    row: dict[str, Any] = {'scene': scene, 'range_m': range_m, 'hours': hours}
    for method in METHODS:
        detector = create_detector(method, SENSOR.grid)
        ids = sum(len(detector.update_all(block)) for block in blocks)
        row[method] = {'false_ids': frequency(ids, hours)}
        if method == 'paper':
            row[method]['false_detections'] = rate(min(detector.counts.candidates, looks), looks)
    return row


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return false preambles a packet time and zone, and false IDs an hour."""
    hours = _QUICK_HOURS if quick else _HOURS
    watched: list[tuple[str, float | None, float]] = [
        *(('silent markers', range_m, hours) for range_m in _RANGES_M),
        ('bare wall', None, hours),
        ('moving hands', None, _RESTLESS_SHARE * hours),
    ]
    return {
        'zones': ZONES,
        'rows': [_watch(*one, rng) for one in tqdm(watched, desc='false-alarms', leave=False)],
    }


def _named(row: dict[str, Any]) -> str:
    return row['scene'] if row['range_m'] is None else f'{row["scene"]} at {row["range_m"]:g} m'


def _told(one: dict[str, Any]) -> str:
    """Return how many IDs were false, as text."""
    return f'{one["events"]} in {one["hours"]:g} h'


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = [f'{"":24}{"false preambles (paper)":>24}   false IDs: paper{"joint":>14}']
    lines += [
        f'{_named(row):24}{row["paper"]["false_detections"]["rate"]:24.2%}'
        f'{_told(row["paper"]["false_ids"]):>19}{_told(row["joint"]["false_ids"]):>14}'
        for row in figures['rows']
    ]
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set false preambles and false IDs beside the paper's."""
    silent = [row for row in figures['rows'] if row['scene'] == 'silent markers']
    claims = [
        Claim(
            'false IDs, silent markers at 1 to 2.6 m',
            'none',
            *(
                f'{sum(row[m]["false_ids"]["events"] for row in silent)} in '
                f'{sum(row["hours"] for row in silent):g} h'
                for m in reversed(METHODS)
            ),
        )
    ]
    for row in figures['rows']:
        if row in silent:
            continue
        told = [_told(row[method]['false_ids']) for method in reversed(METHODS)]
        claims.append(Claim(f'false IDs, {row["scene"]}', 'not told', *told))
        if row['scene'] == 'bare wall':
            false = row['paper']['false_detections']['rate']
            claims.append(
                Claim(
                    'false preambles, a zone and packet time, bare wall',
                    f'{PAPER_FALSE_DETECTIONS:.1%}, of silent markers',
                    f'{false:.2%}',
                )
            )
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say which claim does not survive, and of what scenes the default is afraid."""
    wall = next(row for row in figures['rows'] if row['scene'] == 'bare wall')
    hands = next(row for row in figures['rows'] if row['scene'] == 'moving hands')
    candidates = wall['paper']['false_detections']['hits']
    ids = wall['paper']['false_ids']['events']
    share = f'{ids / candidates:.0%}' if candidates else 'none'
    joint = hands['joint']['false_ids']
    still = [row for row in figures['rows'] if row['scene'] == 'silent markers']
    near = sum(row['paper']['false_detections']['hits'] for row in still)
    silent = (
        f'{sum(row["joint"]["false_ids"]["events"] for row in still)} in '
        f'{sum(row["hours"] for row in still):g} h'
    )
    return (
        'The paper calls the chance of a valid ID after a false preamble negligible. **That claim '
        'does not survive**: 56.8 % of all words of 24 bits are within three bits of a code word, '
        f'and of {candidates} false preambles before a bare wall {share} gave an ID. '
        'With 0.5 % of false preambles, some 900 tries would give two or three, and none with a '
        'chance of about 8 %; how many tries the paper made is not told. Silent markers on a wall '
        f'made {near} false preambles here: the likelihood has the received light in its '
        'denominator.\n\n'
        f'The default allows {USUAL_FALSE_IDS_PER_HOUR:g} false IDs an hour over all zones, '
        f'before whatever wanders; of silent markers it read {silent}, '
        f'before moving hands {joint["events"]} in {joint["hours"]:g} h '
        f'(95 %: {joint["low"]:.0f} to {joint["high"]:.0f} an hour), the paper '
        f'{hands["paper"]["false_ids"]["events"]}. Naming the IDs that may come (`registered_ids`) '
        'does not lower this: what it saves buys reach (docs/choosing.md).'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw false IDs an hour of every scene, with their confidence."""
    figure, ((axis,),) = new_chart(1, 1, 11, 4.8)
    rows = figures['rows']
    for offset, method in zip((-0.12, 0.12), METHODS, strict=True):
        how = {**look(method), 'markersize': 7, 'linestyle': ''}
        for index, row in enumerate(rows):
            ids = row[method]['false_ids']
            label = method if index == 0 else None
            # Where nothing was read, all that is known is the upper bound.
            face = {} if ids['events'] else {'markerfacecolor': 'white'}
            place = ids['per_hour'] or ids['high']
            axis.plot(index + offset, place, label=label, **how, **face)
            low = ids['low'] if ids['events'] else place / 3
            axis.vlines(index + offset, low, ids['high'], colors=how['color'])
    axis.set_yscale('log')
    axis.set_xticks(range(len(rows)), [_named(row).replace(' at ', '\nat ') for row in rows])
    axis.set_ylabel('false IDs an hour, 16 zones, 95 % confidence')
    axis.set_title('open: none seen, drawn at the upper bound of the confidence', fontsize=11)
    axis.legend(fontsize=11, loc='upper left')
    figure.savefig(path)
