# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From light to a marker's identity and place, on one zone: every stage with its real samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from retrolidar_ros.code import BIT_PERIOD_S
from retrolidar_ros.detector.evidence import NoiseLaw
from retrolidar_ros.evaluation.chain.fold import fold_stage
from retrolidar_ros.evaluation.chain.paper import mislock_stage, paper_stage
from retrolidar_ros.evaluation.chain.paper_picture import draw_paper
from retrolidar_ros.evaluation.chain.pictures import (
    draw_bits,
    draw_evidence,
    draw_fit,
    draw_fold,
    draw_samples,
    draw_search,
    draw_soft,
)
from retrolidar_ros.evaluation.chain.place_picture import draw_place
from retrolidar_ros.evaluation.chain.played import CLOCK_ERROR, marker_before_wall, play
from retrolidar_ros.evaluation.chain.stages import (
    bits_stage,
    evidence_stage,
    find,
    fit_stage,
    place_stage,
    samples_stage,
    search_stage,
    soft_stage,
)
from retrolidar_ros.evaluation.claims import Claim
from retrolidar_ros.evaluation.link import SNR
from retrolidar_ros.scene.description import Surface

TITLE = 'The chain on one zone'
SOURCE = 'paper §3.4, §3.5'
STAGES = {
    'samples': draw_samples,
    'bits': draw_bits,
    'soft': draw_soft,
    'search': draw_search,
    'fit': draw_fit,
    'evidence': draw_evidence,
    'fold': draw_fold,
    'place': draw_place,
    'paper': draw_paper,
}
"""What draws each stage, in order."""

# One of the IDs that the paper's method reads best, near the edge of a zone.
_ID = 2096
_POSITION_M = (0.02, 0.215, 1.97)
_WALL = Surface(2.25, 10.0)
_START_S, _DURATION_S = 2.11, 4.4
# In the middle of its zone, and farther away than one packet reaches.
_FAR_M = (0.35, 0.35, 3.16)
_FAR_WALL = Surface(3.3, 4.0)
_FAR_START_S, _FAR_DURATION_S, _FAR_PACKETS = 0.4, 60.0, 3
_SCENES, _QUICK_SCENES = 8, 2
_WIDTH, _HEIGHT = 12.5, 3.6  # of one stage [inches]


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what every stage makes of one packet; `quick` counts fewer packets for the trap."""
    scene = marker_before_wall(_ID, _POSITION_M, _WALL, start_s=_START_S, packets=1)
    played = play(scene, rng, _DURATION_S)
    found = find(played)
    far = marker_before_wall(_ID, _FAR_M, _FAR_WALL, start_s=_FAR_START_S, packets=None)
    range_m = float(np.linalg.norm(_POSITION_M))
    law = NoiseLaw()
    return {
        'marker': {
            'id': _ID,
            'start_s': round(played.truth_start_s, 4),
            'range_m': round(range_m, 2),
            'clock_error_percent': 100 * CLOCK_ERROR,
            'wall_signal': _WALL.signal,
            'wall_m': _WALL.distance_m,
        },
        'bit_s': BIT_PERIOD_S,
        'noise_law': {'floor': law.floor, 'slope': law.slope},
        'samples': samples_stage(played),
        'bits': bits_stage(played, found),
        'soft': soft_stage(played, found),
        'search': search_stage(played, found),
        'fit': fit_stage(played, found),
        'evidence': evidence_stage(played, found),
        'fold': fold_stage(play(far, rng, _FAR_DURATION_S, _FAR_PACKETS)),
        'place': place_stage(played, found),
        'paper': paper_stage(played.recording, played.marker, played.zone),
        'mislock': mislock_stage(scene.sensor, range_m, _QUICK_SCENES if quick else _SCENES, rng),
    }


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw all stages below each other, and each by itself beside it: NAME-1-samples.png."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread, imsave

    pictures = []
    for number, (name, stage) in enumerate(STAGES.items(), start=1):
        figure = Figure(figsize=(_WIDTH, _HEIGHT), dpi=100, layout='constrained')
        stage(figure, figures)
        single = path.with_name(f'{path.stem}-{number}-{name}.png')
        figure.savefig(single)
        pictures.append(imread(single))
    imsave(path, np.concatenate(pictures))


def summarise(figures: dict[str, Any]) -> str:
    """Return the key figures of every stage."""
    search, fit, evidence = figures['search'], figures['fit'], figures['evidence']
    fold, place, paper = figures['fold'], figures['place'], figures['paper']
    mislock = figures['mislock']
    example = mislock['example']
    return '\n'.join(
        [
            (
                f'ID {figures["marker"]["id"]} at {figures["marker"]["range_m"]} m, zones '
                f'{evidence["zones"]}'
            ),
            (
                f'search     ID {search["id"]}, correlation {search["correlation"]:.3f} '
                f'(threshold {search["threshold"]:.3f}), next ID {search["top_correlation"][1]:.3f}'
            ),
            (
                f'fit        start {fit["start_error_ms"]:+.2f} ms, {SNR} {fit["snr_db"]:.1f} dB, '
                f'correlation {fit["score"]:.3f}, χ² {fit["residual"]:.2f}'
            ),
            (
                f'evidence   {evidence["nats"]:.1f} nats (at least {evidence["least_nats"]:.1f}), '
                f'leads by {evidence["lead"]:.1f} (at least {evidence["least_lead"]:.1f})'
            ),
            (
                f'place      range {place["range_error_mm"]:+.1f} mm '
                f'± {place["range_stddev_mm"]:.1f} mm; position '
                f'{place["position_error_mm"]:.0f} mm off, '
                f'{place["squared_distance"] ** 0.5:.1f} standard deviations'
            ),
            (
                f'fold       {fold["packets"]} packets at {fold["range_m"]} m: soft bits '
                f'{_decibels(fold["mean_row_snr_db"])} -> {_decibels(fold["folded_snr_db"])}'
            ),
            (
                f'paper      ID {paper["id"]}, l {paper["largest"]:.2f}, '
                f'start {paper["start_error_ms"]:+.1f} ms'
            ),
            (
                f'trap       of {mislock["packets"]} packets {mislock["continuing"]} go on 01; '
                f'{mislock["late"]} of these are taken up late, {mislock["late_wrong"]} with a '
                f'wrong ID, such as {example["read_id"]} for {example["id"]}'
            ),
        ]
    )


def _decibels(value: float | None) -> str:
    return '–' if value is None else f'{value:.1f} dB'


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Return what both methods make of the same samples."""
    marker, evidence, fit = figures['marker'], figures['evidence'], figures['fit']
    paper, place, mislock = figures['paper'], figures['place'], figures['mislock']
    words = {-1: 'refused'}
    packets, late = mislock['packets'], mislock['late']
    return [
        Claim(
            f'ID {marker["id"]} at {marker["range_m"]} m',
            method=words.get(paper['id'], str(paper['id'])),
            default=str(figures['search']['id']),
        ),
        Claim(
            'bits corrected',
            paper='up to 3',
            method=str(paper['corrected_bits']),
            default=str(evidence['corrected_bits']),
        ),
        Claim(
            'start less the true one',
            method=f'{paper["start_error_ms"]:.1f} ms',
            default=f'{fit["start_error_ms"]:.1f} ms',
        ),
        Claim(
            'correlation with the packet',
            method='–' if paper['score'] is None else f'{paper["score"]:.3f}',
            default=f'{evidence["score"]:.3f}',
        ),
        Claim(
            'range less the true one, a wall behind',
            method='–' if paper['range_error_mm'] is None else f'{paper["range_error_mm"]:.0f} mm',
            default=f'{place["range_error_mm"]:.0f} mm',
        ),
        Claim(
            f'taken up late of {mislock["continuing"]} packets that go on 01',
            method=f'{late} ({mislock["late_wrong"]} as a wrong ID)',
        ),
        Claim(
            f'wrong IDs of {packets} packets',
            method=str(mislock['wrong']),
            default=str(mislock['default_wrong']),
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Return what the pictures show."""
    place, paper, mislock = figures['place'], figures['paper'], figures['mislock']
    example, fold = mislock['example'], figures['fold']
    wall_mm = place['wall_mm'] - place['truth_mm']
    return f"""\
One packet on its way through every stage, with the samples that the stages really had; \
`docs/how_it_works.md` tells it step by step. Single pictures of the stages lie beside this chart.

The marker stands {wall_mm:.0f} mm before a wall of \
{figures['marker']['wall_signal']:g} kcps/SPAD, and the two merge into one pulse. The paper's \
mean of all distances is then {place['mean_mm'] - place['truth_mm']:.0f} mm too long; with the \
background taken off the error is {place['range_error_mm']:.1f} mm. The paper's \
markers were on tripods (§6), and it does not say what stood behind them; before nothing, or on a \
board, the mean is right.

A payload that begins with 01 goes on like the preamble 1010101, so l two bits late is as large as \
at the start, up to noise and the phase of the exposures. Of {mislock['packets']} packets at this \
distance {mislock['continuing']} do, and of these {mislock['late']} are taken up late, \
{mislock['late_wrong']} of them as a wrong ID; here, ID {example['id']} as {example['read_id']} \
with {example['corrected_bits']} bits corrected (l {example['likelihood_taken']:.2f} against \
{example['likelihood_right']:.2f}). The paper does not mention it. Its method reads the packet of \
the first pictures as {paper['id']}, for that ID was chosen not to go on 01.

At {fold['range_m']} m one packet is seldom enough: {fold['packets']} on top of each other raise \
the soft bits from {_decibels(fold['mean_row_snr_db'])} to {_decibels(fold['folded_snr_db'])}, \
where {fold['expected_gain_db']:.1f} dB of gain are to be expected.
"""
