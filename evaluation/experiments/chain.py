# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One packet on one zone: its samples, what was judged while it came, and the reading."""

from typing import Any

import numpy as np

from evaluation.bench.places import place_error
from evaluation.report.chart_style import OTHERS, label, legend_below, line, look, new_chart
from evaluation.report.claims import Claim, Claims, Table
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector, Reason
from retrolidar_ros.marker.code import BIT_PERIOD_S, MAX_CORRECTED_BITS, packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.scene.transmission import Transmission, exposure_edges
from retrolidar_ros.sensor.frame import Recording

TITLE = 'One packet'
MESSAGE = 'Only the complete packet passes all three tests'
# One of the IDs that the paper's method reads best, near the edge of a zone.
_MARKER = Marker(2096, (0.02, 0.215, 1.97), 'marker', start_s=2.11, packets=1, response=RESPONSE)
_WALL = Surface(2.25, 10.0)
_DURATION_S = 4.4
_SHOWN_S = 0.3  # before and after the packet
_READ = 'read'
_SIGNS = {
    _READ: ('o', look('joint')['color']),
    Reason.EVIDENCE.value: ('.', '0.5'),
    Reason.NOT_A_WORD.value: ('x', OTHERS[0]),
    Reason.MARGIN.value: ('^', OTHERS[1]),
    Reason.INCOMPLETE.value: ('v', OTHERS[2]),
    Reason.ERASED.value: ('d', OTHERS[3]),
}


def _samples(recording: Recording, detection: Detection) -> dict[str, Any]:
    """Return the samples of the strongest zone about a packet [s, kcps/SPAD], and its light."""
    first_ns = int(recording.stamp_ns[0])
    time_s = 1e-9 * (recording.stamp_ns - first_ns)
    start_s, end_s = (1e-9 * (one - first_ns) for one in (detection.start_ns, detection.end_ns))
    shown = (time_s > start_s - _SHOWN_S) & (time_s < end_s + _SHOWN_S)
    period_s = float(np.median(np.diff(time_s)))
    sent = Transmission(packet(detection.id), detection.bit_period_s, start_s, RESPONSE, 1)
    share = sent.mean(exposure_edges(time_s[shown], period_s))
    signal = recording.signal[shown, detection.zones[0]].astype(np.float64)
    columns = np.column_stack([np.ones(len(share)), share])
    light = columns @ np.linalg.lstsq(columns, signal, rcond=None)[0]
    return {
        'time_s': time_s[shown].tolist(),
        'signal': signal.tolist(),
        'light': light.tolist(),
        'start_s': start_s,
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what becomes of one packet; `quick` changes nothing."""
    scene = Scene(sensor=load_scene('coffee').sensor, markers=(_MARKER,), surfaces=(_WALL,))
    recording = Simulation(scene, rng).run(_DURATION_S)
    detector = create_detector('joint', recording.grid)
    assert isinstance(detector, LikelihoodDetector)
    rows: list[dict[str, Any]] = []
    detections: list[Detection] = []
    for frame in recording:
        detections += detector.update(frame)
        rows += [
            {
                'time_s': 1e-9 * (frame.stamp_ns - int(recording.stamp_ns[0])),
                'reason': _READ if one.reason is None else one.reason.value,
                **{name: getattr(one, name) for name in ('id', 'evidence', 'word', 'margin')},
            }
            for one in detector.candidates
        ]
    if not detections:
        raise ValueError(f'the marker is not read: {dict(detector.counts.rejected)}')
    detection = detections[0]
    by_paper = create_detector('paper', recording.grid).update_all(recording)
    wrong = place_error(detection.place, np.array(_MARKER.position_m))
    return {
        'range_m': float(np.linalg.norm(_MARKER.position_m)),
        'demands': detector.demands._asdict(),
        'candidates': rows,
        'samples': _samples(recording, detection),
        'ids': [one.id for one in detections],
        'zone': detection.zones[0],
        'evidence': detection.evidence,
        'margin': detection.decision_margin,
        'bits': packet(detection.id).tolist(),
        'corrected_bits': detection.corrected_bits,
        'range_error_mm': 1e3 * wrong.range_m,
        'paper': [{'id': one.id, 'corrected_bits': one.corrected_bits} for one in by_paper],
    }


def table(figures: dict[str, Any]) -> Table:
    """Return what is demanded of the packet, and what it has."""
    asked = figures['demands']
    paper = ', '.join(str(one['id']) for one in figures['paper']) or 'not read'
    return [
        ['question', 'demanded', f'ID {figures["ids"][0]} at {figures["range_m"]:.2f} m'],
        ['evidence', f'at least {asked["evidence"]:.1f} nats', f'{figures["evidence"]:.1f} nats'],
        ['decision margin', f'at least {asked["margin"]:.1f}', f'{figures["margin"]:.1f} nats'],
        ['range', 'the true one', f'{figures["range_error_mm"]:+.0f} mm'],
        ['method `paper`', 'the same ID', paper],
    ]


def claims(figures: dict[str, Any]) -> Claims:
    """Return the bits that were corrected."""
    paper = ', '.join(str(one['corrected_bits']) for one in figures['paper']) or 'not read'
    agrees = bool(figures['ids']) and figures['corrected_bits'] <= MAX_CORRECTED_BITS
    return {'bits': Claim(paper, str(figures['corrected_bits']), agrees)}


def draw(figures: dict[str, Any]) -> Any:
    """Draw samples, and evidence, word test and margin of the candidates over time."""
    figure, (top, *panels) = new_chart(4, 1, 10, MESSAGE)
    samples, highest = figures['samples'], max(figures['samples']['signal'])
    fitted = line('-', look('joint')['color'])
    top.plot(samples['time_s'], samples['signal'], '.', color='0.3')
    top.plot(samples['time_s'], samples['light'], **fitted)
    for index, bit in enumerate(figures['bits']):
        at_s = samples['start_s'] + (index + 0.5) * BIT_PERIOD_S
        top.text(at_s, 1.06 * highest, str(bit), ha='center', fontsize=9)
    title = f'zone {figures["zone"]}: ID {figures["ids"][0]}'
    label(top, '', 'signal [kcps/SPAD]', title, ylim=(0, 1.18 * highest))
    # Each question is asked of those only that have answered the one before.
    worded = (_READ, Reason.MARGIN.value, Reason.NOT_A_WORD.value)
    axes = (
        ('evidence', 'evidence [nats]', 'at least', tuple(_SIGNS)),
        ('word', 'better sequence of bits [nats]', 'at most', worded),
        ('margin', 'decision margin [nats]', 'at least', worded[:2]),
    )
    others = {'samples': line('', '0.3') | {'marker': '.'}, 'fitted': fitted}
    for axis, (name, y, limit, asked_of) in zip(panels, axes, strict=True):
        for reason in asked_of:
            sign, colour = _SIGNS[reason]
            rows = [row for row in figures['candidates'] if row['reason'] == reason]
            if rows:
                others[reason] = line('', colour) | {'marker': sign}
                times_s, values = ([row[key] for row in rows] for key in ('time_s', name))
                axis.plot(times_s, values, **others[reason])
        asked = figures['demands'][name]
        axis.axhline(asked, **line('--', '0.4'), linewidth=1)
        axis.text(0.005, asked, limit, transform=axis.get_yaxis_transform(), va='bottom')
        label(axis, 'time [s]' if axis is panels[-1] else '', y, xlim=top.get_xlim())
    legend_below(figure, (), others)
    return figure
