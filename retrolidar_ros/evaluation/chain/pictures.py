# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One picture a stage of the chain, from the figures alone.

Each function draws into an empty figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from retrolidar_ros.code import ID_BITS, PREAMBLE
from retrolidar_ros.detector.rivals import ENOUGH_NATS
from retrolidar_ros.evaluation.charts import look
from retrolidar_ros.frame import Status

OURS, PAPER = look('joint')['color'], look('paper')['color']
SAMPLE, TRUTH, LIMIT = '0.25', '#009e73', '#d55e00'
DARK, BRIGHT = '0.3', '#f0e442'
SMALL = {'fontsize': 9}
_STATUS_COLOURS = {Status.VALID: '#56b4e9', Status.MERGED: '#e69f00'}
_STATUS_NAMES = {Status.VALID: 'status 5, valid', Status.MERGED: 'status 9, two merged'}


def panels(figure: Any, title: str, ratios: Sequence[float]) -> list[Any]:
    """Return panels side by side, of relative widths, under a title."""
    figure.suptitle(title, fontsize=12, x=0.01, ha='left', weight='bold')
    row = figure.subplots(1, len(ratios), gridspec_kw={'width_ratios': ratios}, squeeze=False)
    for panel in row[0]:
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=9)
    return list(row[0])


def draw_samples(figure: Any, figures: dict[str, Any]) -> None:
    """Draw signal, distance and status of the zone over time."""
    stage = figures['samples']
    title = f'1  What the sensor says of zone {stage["zone"]}'
    signal, distance = panels(figure, title, (2, 1.2))
    time_s, status = np.array(stage['time_s']), np.array(stage['status'])
    for panel, name in ((signal, 'signal'), (distance, 'distance_m')):
        values = np.array(stage[name], dtype=float)
        panel.plot(time_s, values, color='0.7', linewidth=0.8)
        for code in sorted(set(status.tolist())):
            own = status == code
            panel.plot(
                time_s[own],
                values[own],
                '.',
                color=_STATUS_COLOURS.get(code, LIMIT),
                label=_STATUS_NAMES.get(code, f'status {code}'),
            )
        panel.set_xlabel('time [s]')
    signal.set_ylabel('signal [kcps/SPAD]')
    distance.set_ylabel('distance as reported [m]')
    signal.legend(loc='lower left', **SMALL)


def draw_strip(panel: Any, bits: Sequence[int], bottom: float, height: float) -> None:
    """Draw bits as a strip of dark and bright boxes from 0 on."""
    for index, bit in enumerate(bits):
        panel.add_patch(_box(index, bottom, height, DARK if bit else BRIGHT))


def _box(left: float, bottom: float, height: float, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((left, bottom), 1, height, facecolor=colour, edgecolor='white', linewidth=0.8)


def draw_bits(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the packet, and its light continuously and in exposures."""
    stage = figures['bits']
    strip, light = panels(figure, '2  What a packet should look like', (1, 1.3))
    draw_strip(strip, stage['bits'], 0.35, 0.3)
    head = len(PREAMBLE)
    for left, right, name in (
        (0, head, 'preamble'),
        (head, head + ID_BITS, f'the 12 bits of ID {figures["marker"]["id"]}'),
        (head + ID_BITS, len(stage['bits']), '12 parity bits'),
    ):
        strip.annotate('', (left, 0.25), (right, 0.25), arrowprops={'arrowstyle': '<->'})
        strip.text((left + right) / 2, 0.12, name, ha='center', **SMALL)
    for index, bit in enumerate(stage['bits']):
        strip.text(index + 0.5, 0.69, str(bit), ha='center', **SMALL)
    strip.set_xlim(0, len(stage['bits']))
    strip.set_ylim(0, 1)
    strip.set_yticks([])
    strip.grid(False)
    strip.set_xlabel(f'bit (each {stage["bit_ms"]:.1f} ms; 1 = dark)')
    time_s = np.array(stage['time_s']) - stage['start_s']
    light.plot(1e3 * time_s, stage['light'], color='0.5', label='light of the marker')
    begin_s = np.array(stage['begin_s']) - stage['start_s']
    end_s = np.array(stage['end_s']) - stage['start_s']
    light.hlines(
        stage['exposed'], 1e3 * begin_s, 1e3 * end_s, color=OURS, linewidth=3, label='exposures'
    )
    light.set_xlabel('time since the packet began [ms]')
    light.set_ylabel('share of the light')
    light.set_ylim(-0.05, 1.25)
    light.legend(loc='upper right', ncols=2, **SMALL)


def draw_soft(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the soft bits of the packet."""
    stage, bits = figures['soft'], np.array(figures['bits']['bits'])
    (panel,) = panels(figure, '3  Soft bits: how dark each bit was', (1,))
    value = np.array(stage['value'])
    for bit, colour, name in ((1, DARK, 'sent dark (1)'), (0, BRIGHT, 'sent bright (0)')):
        own = np.flatnonzero(bits == bit)
        panel.bar(own, value[own], color=colour, edgecolor='0.3', linewidth=0.5, label=name)
    panel.axhline(0, color='0.3', linewidth=0.8)
    panel.axvline(len(PREAMBLE) - 0.5, color='0.5', linestyle=':')
    panel.set_xlabel('bit of the packet (the preamble ends at the dotted line)')
    panel.set_ylabel('light missing\n[samples · kcps/SPAD]')
    panel.set_xlim(-0.7, len(value) - 0.3)
    panel.set_ylim(min(value) * 1.15, max(value) * 1.35)
    panel.legend(loc='upper right', ncols=2, **SMALL)


def draw_search(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the best correlation at every start, and of all IDs at the best start."""
    stage = figures['search']
    line, words = panels(figure, '4  The search: every ID at every start', (1.3, 1))
    line.plot(stage['start_s'], stage['best'], color=OURS, linewidth=1, label='best of all IDs')
    right = np.array(stage['right']) == 1
    line.plot(
        np.array(stage['start_s'])[right],
        np.array(stage['best'])[right],
        'o',
        color=TRUTH,
        markersize=3.5,
        label=f'where that is ID {stage["id"]}',
    )
    line.axvline(figures['marker']['start_s'], color=TRUTH, linestyle=':', label='true start')
    line.axhline(stage['threshold'], color=LIMIT, linestyle='--', label='threshold')
    line.set_xlabel('start that is tried [s]')
    line.set_ylabel('correlation')
    line.set_ylim(0, 1.05)
    line.legend(loc='upper left', **SMALL)
    bins = stage['bins']
    for name, colour, label in (
        ('ids_in_silence', '0.6', 'while the marker was silent'),
        ('ids_at_start', OURS, 'at the best start'),
    ):
        words.stairs(np.array(stage[name]) + 0.5, bins, baseline=0.5, color=colour, label=label)
    words.axvline(stage['threshold'], color=LIMIT, linestyle='--')
    words.annotate(
        f'ID {stage["id"]}',
        (stage['correlation'], 1.5),
        (stage['correlation'] - 0.02, 20),
        ha='center',
        arrowprops={'arrowstyle': '->'},
        **SMALL,
    )
    words.set_yscale('log')
    words.set_xlim(-0.6, 1.0)
    words.set_ylim(0.5, 3000)
    words.set_xlabel('correlation')
    words.set_ylabel('IDs per 0.02')
    words.legend(loc='upper left', **SMALL)


def draw_fit(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the fitted packet over the samples, and what is left over."""
    stage = figures['fit']
    over, left = panels(figure, '5  The exact fit, and what it leaves over', (1.5, 1))
    over.plot(stage['time_s'], stage['expected'], color=OURS, linewidth=1.2, label='fitted packet')
    over.plot(stage['time_s'], stage['signal'], '.', color=SAMPLE, label='samples')
    over.set_xlabel('time [s]')
    over.set_ylabel('signal [kcps/SPAD]')
    over.set_ylim(0, 1.25 * max(stage['signal']))
    over.legend(loc='upper right', ncols=2, **SMALL)
    left.axhspan(-2, 2, color=OURS, alpha=0.12, linewidth=0)
    left.plot(stage['time_s'], stage['normalised'], '.', color=SAMPLE)
    left.set_xlabel('time [s]')
    left.set_ylabel('left over, in standard\ndeviations of the noise')
    left.set_ylim(-4.5, 4.5)
    left.text(
        0.02,
        0.92,
        f'χ² per degree of freedom: {stage["residual"]:.2f}',
        transform=left.transAxes,
        **SMALL,
    )


def draw_evidence(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the likeliest IDs, and the tests beside their limits."""
    search, stage = figures['search'], figures['evidence']
    rivals, table = panels(figure, '6  The evidence', (1, 1.3))
    places = np.arange(len(search['top_ids']))
    colours = [OURS] + ['0.7'] * (len(places) - 1)
    rivals.bar(places, search['top_nats'], color=colours)
    rivals.set_xticks(
        places,
        [f'{one}\n{d}' for one, d in zip(search['top_ids'], search['top_distance'], strict=True)],
    )
    rivals.set_xlabel('ID; bits in which its packet differs')
    rivals.set_ylabel('likelihood ratio to\nnoise [nats]')
    table.axis('off')
    zones = ' + '.join(str(zone) for zone in stage['zones'])
    rows = [
        ('against noise [nats]', f'{stage["nats"]:.1f}', f'≥ {stage["least_nats"]:.1f}'),
        ('left over, χ² per d.o.f.', f'{stage["residual"]:.2f}', f'≤ {stage["most_residual"]:.1f}'),
        (
            'against the next ID [nats]',
            _lead(stage['lead']),
            f'≥ {stage["least_lead"]:.1f}',
        ),
    ]
    drawn = table.table(
        cellText=rows,
        colLabels=(f'test (zones {zones})', 'measured', 'limit'),
        colWidths=(0.55, 0.2, 0.2),
        cellLoc='center',
        loc='center',
    )
    drawn.auto_set_font_size(False)
    drawn.set_fontsize(10)
    drawn.scale(1, 2)


def _lead(lead: float) -> str:
    """Return a lead as text; beyond some point it is not known exactly."""
    return f'{lead:.1f}' if lead < ENOUGH_NATS else f'≥ {ENOUGH_NATS:.0f}'


def draw_fold(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the soft bits of packets one by one and together, and their correlations."""
    stage = figures['fold']
    packets = stage['packets']
    title = f'7  {packets} packets laid on top of each other, at {stage["range_m"]} m'
    bits, correlation = panels(figure, title, (1.6, 1))
    rows = [*stage['rows'], stage['folded'], np.array(stage['bits']) - 0.5]
    scaled = [np.array(row) / np.abs(row).max() for row in rows]
    bits.imshow(scaled, cmap='cividis_r', aspect='auto', vmin=-1, vmax=1)
    bits.axhline(packets - 0.5, color='white', linewidth=4)
    bits.axhline(packets + 0.5, color='white', linewidth=4)
    snr = [
        f'packet {index + 1}: {"–" if value is None else f"{value:.1f} dB"}'
        for index, value in enumerate(stage['row_snr_db'])
    ]
    bits.set_yticks(range(packets + 2), [*snr, f'all: {stage["folded_snr_db"]:.1f} dB', 'sent'])
    bits.set_xlabel('bit of the packet (dark colours: dark bits)')
    bits.grid(False)
    places = np.arange(len(stage['single_correlation']))
    right = np.array(stage['single_ids']) == stage['id']
    colours = np.where(right, TRUTH, LIMIT)
    correlation.bar(places, stage['single_correlation'], color=colours)
    last = len(places)
    correlation.bar(last, stage['correlation'], color=TRUTH)
    for left, right_end, limit in (
        (-0.45, last - 0.55, stage['single_threshold']),
        (last - 0.45, last + 0.45, stage['threshold']),
    ):
        correlation.hlines(limit, left, right_end, color='black', linestyle='--')
    names = [f'{index + 1}\n{one}' for index, one in enumerate(stage['single_ids'])]
    correlation.set_xticks(range(last + 1), [*names, f'all\n{stage["id"]}'])
    correlation.set_xlabel('packet, and the best ID (green: the right one)')
    correlation.set_ylabel('correlation, and\nthreshold (dashed)')
    correlation.set_ylim(0, 1)
