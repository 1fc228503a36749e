# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One packet on one zone: its samples, the candidates meanwhile, and the reading."""

from typing import Any

import numpy as np

from evaluation.bench.judging import watch
from evaluation.report import chart_style as charts
from evaluation.report.chart_style import label, line, look
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.detector.detection import Reason
from retrolidar_ros.marker.code import BIT_PERIOD_S, packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface, load_scene
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.scene.transmission import Transmission, exposure_edges
from retrolidar_ros.sensor.frame import Recording

TITLE = 'One packet'
# One of the IDs that the paper's method reads best, near the edge of a zone.
_MARKER = Marker(2096, (0.02, 0.215, 1.97), 'marker', start_s=2.11, packets=1, response=RESPONSE)
_WALL = Surface(2.25, 10.0)
_DURATION_S = 4.4
_SHOWN_S = 0.3  # before and after the packet
_READ = 'read'
_SIGNS = {
    _READ: ('o', look('joint')['color']),
    Reason.EVIDENCE.value: ('.', '0.5'),
    Reason.NOT_A_WORD.value: ('x', charts.OTHERS[0]),
    Reason.MARGIN.value: ('^', charts.OTHERS[1]),
    Reason.INCOMPLETE.value: ('v', charts.OTHERS[2]),
    Reason.ERASED.value: ('d', charts.OTHERS[3]),
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
    rows = {'time_s': time_s[shown], 'signal': signal, 'light': light}
    return {name: row.tolist() for name, row in rows.items()} | {'start_s': start_s}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return samples, candidates and reading of one packet; `quick` changes nothing."""
    scene = Scene(sensor=load_scene('coffee').sensor, markers=(_MARKER,), surfaces=(_WALL,))
    recording = Simulation(scene, rng).run(_DURATION_S)
    detector = create_detector('joint', recording.grid)
    assert detector.thresholds is not None
    rows: list[dict[str, Any]] = []
    detections: list[Detection] = []
    for step in watch(detector, recording):
        detections += step.detections
        for one in detector.candidates:
            reason = _READ if one.reason is None else one.reason.value
            values = {name: getattr(one, name) for name in ('id', 'evidence', 'word', 'margin')}
            rows.append({'time_s': step.known_s, 'reason': reason, **values})
    detection = detections[0]
    return {
        'thresholds': detector.thresholds._asdict(),
        'candidates': rows,
        'samples': _samples(recording, detection),
        'ids': [one.id for one in detections],
        'zone': detection.zones[0],
        'bits': packet(detection.id).tolist(),
    }


def draw(figures: dict[str, Any]) -> Any:
    """Draw samples, evidence of the candidates over time, and all tests of the one that is read."""
    candidates = figures['candidates']
    samples, highest = figures['samples'], max(figures['samples']['signal'])
    read = [row for row in candidates if row['reason'] == _READ]
    sent = min(len(figures['bits']), int((read[0]['time_s'] - samples['start_s']) / BIT_PERIOD_S))
    when = f'when {sent} of {len(figures["bits"])} bits have come'
    title = f'Of {len(candidates)} candidates, {len(read)} passes all three tests, {when}'
    figure, (top, below) = charts.new_chart(2, 1, 6, title)
    below.sharex(top)
    fitted = line('-', look('joint')['color'])
    top.plot(samples['time_s'], samples['signal'], '.', color='0.3')
    top.plot(samples['time_s'], samples['light'], **fitted)
    for index, bit in enumerate(figures['bits']):
        at_s = samples['start_s'] + (index + 0.5) * BIT_PERIOD_S
        top.text(at_s, 1.06 * highest, str(bit), ha='center', fontsize=9)
    title = f'zone {figures["zone"]}: ID {figures["ids"][0]}; bits sent, 1 = dark'
    label(top, '', 'signal [kcps/SPAD]', title, ylim=(0, 1.18 * highest))
    others = {'samples': line('', '0.3') | {'marker': '.'}, 'fitted': fitted}
    for reason, (sign, colour) in _SIGNS.items():
        rows = [row for row in candidates if row['reason'] == reason]
        if rows:
            name = f'{"" if reason == _READ else "rejected: "}{reason} ×{len(rows)}'
            others[name] = line('', colour) | {'marker': sign}
            times_s, values = ([row[key] for row in rows] for key in ('time_s', 'evidence'))
            below.plot(times_s, values, **others[name])
    threshold = figures['thresholds']
    # Only what has evidence is put to the other two tests.
    words = (
        f'what is read has\nother bits: {read[0]["word"]:.0f} (≤ {threshold["word"]:.0f})\n'
        f'margin to other IDs: {read[0]["margin"]:.0f} (≥ {threshold["margin"]:.0f})'
    )
    below.text(0.02, 0.95, words, va='top', fontsize=10.5, transform=below.transAxes)
    charts.draw_level(below, threshold['evidence'], 'threshold', 0.1, linestyle='--')
    below.margins(y=0.15)
    label(below, 'time [s]', 'evidence [nats]')
    charts.legend_below(figure, (), others)
    return figure
