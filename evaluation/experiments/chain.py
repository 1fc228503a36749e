# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One packet on one zone: its samples, what was judged while it came, and the reading."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evaluation.bench.live import place_error
from evaluation.bench.transmissions import transmission
from evaluation.report.charts import look, new_chart
from evaluation.report.claims import NOTHING, Claim
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.detector.likelihood_detector import Candidate, LikelihoodDetector
from retrolidar_ros.detector.reason import Reason
from retrolidar_ros.marker.code import BIT_PERIOD_S, packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.sensor.frame import Floats, Recording

TITLE = 'One packet'
SOURCE = 'paper §3.4, §3.5'

# One of the IDs that the paper's method reads best, near the edge of a zone.
_ID = 2096
_POSITION_M = (0.02, 0.215, 1.97)
_WALL = Surface(2.25, 10.0)
_START_S, _DURATION_S = 2.11, 4.4
_CLOCK_ERROR = 0.002
_SHOWN_S = 0.3  # before and after the packet
_READ = 'read'
_SIGNS = {
    _READ: ('o', '#0072b2'),
    Reason.EVIDENCE.value: ('.', '0.5'),
    Reason.NOT_A_WORD.value: ('x', '#d55e00'),
    Reason.MARGIN.value: ('^', '#cc79a7'),
    Reason.INCOMPLETE.value: ('v', '#009e73'),
    Reason.ERASED.value: ('d', '#e69f00'),
}


def scene_of_one() -> Scene:
    """Return one marker before a wall, with the sensor of the coffee scene."""
    marker = Marker(
        id=_ID,
        position_m=_POSITION_M,
        name='marker',
        start_s=_START_S,
        packets=1,
        clock_error=_CLOCK_ERROR,
        response=RESPONSE,
    )
    return Scene(sensor=load_scene('coffee').sensor, markers=(marker,), surfaces=(_WALL,))


def fitted(recording: Recording, detection: Detection) -> dict[str, Any]:
    """Return the samples of the strongest zone about a packet, and its fitted light.

    Returns
    -------
    dict
        'time_s' since the first frame, 'signal' and 'light' [kcps/SPAD], each of the samples.
    """
    time_s = 1e-9 * (recording.stamp_ns - recording.stamp_ns[0])
    start_s = 1e-9 * (detection.start_ns - int(recording.stamp_ns[0]))
    end_s = 1e-9 * (detection.end_ns - int(recording.stamp_ns[0]))
    shown = (time_s > start_s - _SHOWN_S) & (time_s < end_s + _SHOWN_S)
    half_s = float(np.median(np.diff(time_s))) / 2
    edges_s = np.append(time_s[shown] - half_s, time_s[shown][-1] + half_s)
    share = transmission(
        edges_s,
        np.array([detection.id]),
        np.array([start_s]),
        np.array([detection.bit_period_s]),
        RESPONSE,
    )
    signal = recording.signal[shown, detection.zones[0]].astype(np.float64)
    columns = np.column_stack([np.ones(len(share)), share])
    light: Floats = columns @ np.linalg.lstsq(columns, signal, rcond=None)[0]
    return {
        'time_s': np.round(time_s[shown], 4).tolist(),
        'signal': np.round(signal, 2).tolist(),
        'light': np.round(light, 2).tolist(),
    }


def _row(candidate: Candidate, time_s: float) -> dict[str, Any]:
    """Return what a candidate came to, and when."""
    return {
        'time_s': round(time_s, 4),
        'id': candidate.id,
        'zone': candidate.zone,
        'reason': _READ if candidate.reason is None else candidate.reason.value,
        'evidence': round(candidate.evidence, 2),
        'word': round(candidate.word, 2),
        'margin': round(candidate.margin, 2),
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what becomes of one packet; `quick` changes nothing."""
    scene = scene_of_one()
    (marker,) = scene.markers
    recording = Simulation(scene, rng).run(_DURATION_S)
    detector = create_detector('joint', recording.grid)
    assert isinstance(detector, LikelihoodDetector)
    rows: list[dict[str, Any]] = []
    detections: list[Detection] = []
    for frame in recording:
        detections += detector.update(frame)
        time_s = 1e-9 * (frame.stamp_ns - int(recording.stamp_ns[0]))
        rows += [_row(candidate, time_s) for candidate in detector.candidates]
    if not detections:
        raise ValueError(f'the marker is not read: {dict(detector.counts.rejected)}')
    detection = detections[0]
    wrong = place_error(detection.place, np.array(marker.position_m))
    by_paper = create_detector('paper', recording.grid).update_all(recording)
    return {
        'marker': {'id': _ID, 'range_m': round(float(np.linalg.norm(_POSITION_M)), 3)},
        'demands': detector.demands._asdict(),
        'candidates': rows,
        'samples': fitted(recording, detection),
        'reading': {
            'ids': [one.id for one in detections],
            'zones': list(detection.zones),
            'evidence': round(detection.evidence, 1),
            'margin': round(detection.decision_margin, 1),
            'bits': packet(detection.id).tolist(),
            'start_s': round(1e-9 * (detection.start_ns - int(recording.stamp_ns[0])), 4),
            'bit_error_percent': round(
                100 * (detection.bit_period_s / (BIT_PERIOD_S * (1 + _CLOCK_ERROR)) - 1), 3
            ),
            'score': round(detection.score, 3),
            'corrected_bits': detection.corrected_bits,
            'range_error_mm': round(1e3 * wrong.range_m, 1),
            'position_error_mm': round(1e3 * wrong.position_m, 1),
        },
        'paper': [{'id': one.id, 'corrected_bits': one.corrected_bits} for one in by_paper],
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return the candidates as a table, and the reading."""
    lines = ['time [s]    ID  zone  evidence    word  margin  [nats]']
    lines += [
        f'{row["time_s"]:8.3f}{row["id"]:6d}{row["zone"]:6d}{row["evidence"]:10.1f}'
        f'{row["word"]:8.1f}{row["margin"]:8.1f}  {row["reason"]}'
        for row in figures['candidates']
    ]
    reading = figures['reading']
    lines.append(
        f'ID {", ".join(map(str, reading["ids"]))} in zones '
        f'{", ".join(map(str, reading["zones"]))}: evidence {reading["evidence"]:.1f}, margin '
        f'{reading["margin"]:.1f} nats, range {reading["range_error_mm"]:+.1f} mm'
    )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Return what both methods make of the same samples."""
    marker, reading, asked = figures['marker'], figures['reading'], figures['demands']
    return [
        Claim(
            f'ID {marker["id"]} at {marker["range_m"]:.2f} m',
            method=', '.join(str(one['id']) for one in figures['paper']) or 'not read',
            default=', '.join(map(str, reading['ids'])),
        ),
        Claim(
            'bits corrected',
            paper='up to 3',
            method=', '.join(str(one['corrected_bits']) for one in figures['paper']) or NOTHING,
            default=str(reading['corrected_bits']),
        ),
        Claim(
            f'evidence, of {asked["evidence"]:.1f} nats that are asked',
            default=f'{reading["evidence"]:.1f}',
        ),
        Claim(
            f'decision margin, of {asked["margin"]:.1f} nats that are asked',
            default=f'{reading["margin"]:.1f}',
        ),
        Claim(
            'range less the true one, a wall behind',
            default=f'{reading["range_error_mm"]:.0f} mm',
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say what the picture shows."""
    return (
        'One packet of a marker before a wall, and every candidate that was judged while it came. '
        'A candidate of another start or another ID may have evidence, too: what is sent is like '
        'it. The word test and the decision margin tell them apart. '
        '`docs/how_it_works.md` has the three questions.'
    )


def _draw_samples(axes: Any, figures: dict[str, Any]) -> None:
    """Draw the samples of the zone, the fitted light and the bits."""
    samples, reading = figures['samples'], figures['reading']
    axes.plot(samples['time_s'], samples['signal'], '.', color='0.3', label='samples')
    axes.plot(samples['time_s'], samples['light'], color=look('joint')['color'], label='fitted')
    highest = max(samples['signal'])
    for index, bit in enumerate(reading['bits']):
        at_s = reading['start_s'] + (index + 0.5) * BIT_PERIOD_S
        axes.text(at_s, 1.06 * highest, str(bit), ha='center', fontsize=7)
    axes.set_ylim(top=1.15 * highest)
    axes.set_ylabel('signal [kcps/SPAD]')
    axes.set_title(f'zone {reading["zones"][0]}: ID {reading["ids"][0]}', fontsize=11)
    axes.legend(fontsize=9, loc='lower left')


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw samples, and evidence, word test and margin of the candidates over time."""
    figure, axes = new_chart(4, 1, 11, 12)
    _draw_samples(axes[0, 0], figures)
    asked = figures['demands']
    # Each question is asked of those only that have answered the one before.
    worded = (_READ, Reason.MARGIN.value, Reason.NOT_A_WORD.value)
    panels = (
        ('evidence', 'evidence [nats]', 'at least', tuple(_SIGNS)),
        ('word', 'better sequence of bits [nats]', 'at most', worded),
        ('margin', 'decision margin [nats]', 'at least', worded[:2]),
    )
    for axis, (name, label, limit, asked_of) in zip(axes[1:, 0], panels, strict=True):
        for reason in asked_of:
            sign, colour = _SIGNS[reason]
            rows = [row for row in figures['candidates'] if row['reason'] == reason]
            if rows:
                times_s = [row['time_s'] for row in rows]
                values = [row[name] for row in rows]
                axis.plot(times_s, values, sign, color=colour, label=reason)
        axis.axhline(asked[name], color='0.4', linestyle='--', linewidth=1)
        axis.text(0.005, asked[name], limit, transform=axis.get_yaxis_transform(), va='bottom')
        axis.set_xlim(axes[0, 0].get_xlim())
        axis.set_ylabel(label)
    axes[1, 0].legend(fontsize=9, loc='upper left')
    axes[3, 0].set_xlabel('time [s]')
    figure.savefig(path)
