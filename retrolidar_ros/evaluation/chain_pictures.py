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
from retrolidar_ros.evaluation.live import ELLIPSOID
from retrolidar_ros.frame import Floats, Status

_OURS, _PAPER = look('joint')['color'], look('paper')['color']
_SAMPLE, _TRUTH, _LIMIT = '0.25', '#009e73', '#d55e00'
_DARK, _BRIGHT = '0.3', '#f0e442'
_SMALL = {'fontsize': 9}
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
                color=_STATUS_COLOURS.get(code, _LIMIT),
                label=_STATUS_NAMES.get(code, f'status {code}'),
            )
        panel.set_xlabel('time [s]')
    signal.set_ylabel('signal [kcps/SPAD]')
    distance.set_ylabel('distance as reported [m]')
    signal.legend(loc='lower left', **_SMALL)


def _strip(panel: Any, bits: Sequence[int], bottom: float, height: float) -> None:
    """Draw bits as a strip of dark and bright boxes from 0 on."""
    for index, bit in enumerate(bits):
        panel.add_patch(_box(index, bottom, height, _DARK if bit else _BRIGHT))


def _box(left: float, bottom: float, height: float, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle((left, bottom), 1, height, facecolor=colour, edgecolor='white', linewidth=0.8)


def draw_bits(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the packet, and its light continuously and in exposures."""
    stage = figures['bits']
    strip, light = panels(figure, '2  What a packet should look like', (1, 1.3))
    _strip(strip, stage['bits'], 0.35, 0.3)
    head = len(PREAMBLE)
    for left, right, name in (
        (0, head, 'preamble'),
        (head, head + ID_BITS, f'the 12 bits of ID {figures["marker"]["id"]}'),
        (head + ID_BITS, len(stage['bits']), '12 parity bits'),
    ):
        strip.annotate('', (left, 0.25), (right, 0.25), arrowprops={'arrowstyle': '<->'})
        strip.text((left + right) / 2, 0.12, name, ha='center', **_SMALL)
    for index, bit in enumerate(stage['bits']):
        strip.text(index + 0.5, 0.69, str(bit), ha='center', **_SMALL)
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
        stage['exposed'], 1e3 * begin_s, 1e3 * end_s, color=_OURS, linewidth=3, label='exposures'
    )
    light.set_xlabel('time since the packet began [ms]')
    light.set_ylabel('share of the light')
    light.set_ylim(-0.05, 1.25)
    light.legend(loc='upper right', ncols=2, **_SMALL)


def draw_soft(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the soft bits of the packet."""
    stage, bits = figures['soft'], np.array(figures['bits']['bits'])
    (panel,) = panels(figure, '3  Soft bits: how dark each bit was', (1,))
    value = np.array(stage['value'])
    for bit, colour, name in ((1, _DARK, 'sent dark (1)'), (0, _BRIGHT, 'sent bright (0)')):
        own = np.flatnonzero(bits == bit)
        panel.bar(own, value[own], color=colour, edgecolor='0.3', linewidth=0.5, label=name)
    panel.axhline(0, color='0.3', linewidth=0.8)
    panel.axvline(len(PREAMBLE) - 0.5, color='0.5', linestyle=':')
    panel.set_xlabel('bit of the packet (the preamble ends at the dotted line)')
    panel.set_ylabel('light missing\n[samples · kcps/SPAD]')
    panel.set_xlim(-0.7, len(value) - 0.3)
    panel.set_ylim(min(value) * 1.15, max(value) * 1.35)
    panel.legend(loc='upper right', ncols=2, **_SMALL)


def draw_search(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the best correlation at every start, and of all IDs at the best start."""
    stage = figures['search']
    line, words = panels(figure, '4  The search: every ID at every start', (1.3, 1))
    line.plot(stage['start_s'], stage['best'], color=_OURS, linewidth=1, label='best of all IDs')
    right = np.array(stage['right']) == 1
    line.plot(
        np.array(stage['start_s'])[right],
        np.array(stage['best'])[right],
        'o',
        color=_TRUTH,
        markersize=3.5,
        label=f'where that is ID {stage["id"]}',
    )
    line.axvline(figures['marker']['start_s'], color=_TRUTH, linestyle=':', label='true start')
    line.axhline(stage['threshold'], color=_LIMIT, linestyle='--', label='threshold')
    line.set_xlabel('start that is tried [s]')
    line.set_ylabel('correlation')
    line.set_ylim(0, 1.05)
    line.legend(loc='upper left', **_SMALL)
    bins = stage['bins']
    for name, colour, label in (
        ('ids_in_silence', '0.6', 'while the marker was silent'),
        ('ids_at_start', _OURS, 'at the best start'),
    ):
        words.stairs(np.array(stage[name]) + 0.5, bins, baseline=0.5, color=colour, label=label)
    words.axvline(stage['threshold'], color=_LIMIT, linestyle='--')
    words.annotate(
        f'ID {stage["id"]}',
        (stage['correlation'], 1.5),
        (stage['correlation'] - 0.02, 20),
        ha='center',
        arrowprops={'arrowstyle': '->'},
        **_SMALL,
    )
    words.set_yscale('log')
    words.set_xlim(-0.6, 1.0)
    words.set_ylim(0.5, 3000)
    words.set_xlabel('correlation')
    words.set_ylabel('IDs per 0.02')
    words.legend(loc='upper left', **_SMALL)


def draw_fit(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the fitted packet over the samples, and what is left over."""
    stage = figures['fit']
    over, left = panels(figure, '5  The exact fit, and what it leaves over', (1.5, 1))
    over.plot(stage['time_s'], stage['expected'], color=_OURS, linewidth=1.2, label='fitted packet')
    over.plot(stage['time_s'], stage['signal'], '.', color=_SAMPLE, label='samples')
    over.set_xlabel('time [s]')
    over.set_ylabel('signal [kcps/SPAD]')
    over.set_ylim(0, 1.25 * max(stage['signal']))
    over.legend(loc='upper right', ncols=2, **_SMALL)
    left.axhspan(-2, 2, color=_OURS, alpha=0.12, linewidth=0)
    left.plot(stage['time_s'], stage['normalised'], '.', color=_SAMPLE)
    left.set_xlabel('time [s]')
    left.set_ylabel('left over, in standard\ndeviations of the noise')
    left.set_ylim(-4.5, 4.5)
    left.text(
        0.02,
        0.92,
        f'χ² per degree of freedom: {stage["residual"]:.2f}',
        transform=left.transAxes,
        **_SMALL,
    )


def draw_evidence(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the likeliest IDs, and the tests beside their limits."""
    search, stage = figures['search'], figures['evidence']
    rivals, table = panels(figure, '6  The evidence', (1, 1.3))
    places = np.arange(len(search['top_ids']))
    colours = [_OURS] + ['0.7'] * (len(places) - 1)
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
    colours = np.where(right, _TRUTH, _LIMIT)
    correlation.bar(places, stage['single_correlation'], color=colours)
    last = len(places)
    correlation.bar(last, stage['correlation'], color=_TRUTH)
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


def _ellipse(covariance: Floats, axes: tuple[int, int]) -> Floats:
    """Return the shadow of the 95 % ellipsoid on two axes, shape (2, points)."""
    turn = np.linspace(0, 2 * np.pi, 100)
    root = np.linalg.cholesky(covariance[np.ix_(axes, axes)])
    outline: Floats = np.sqrt(ELLIPSOID) * root @ np.stack([np.cos(turn), np.sin(turn)])
    return outline


def draw_place(figure: Any, figures: dict[str, Any]) -> None:
    """Draw range, shares of the zones, and the ellipsoid from above and from the side."""
    stage = figures['place']
    title = '8  The place: range, bearing, ellipsoid'
    scatter, shares, above, beside = panels(figure, title, (1.25, 1, 1, 1))
    scatter.scatter(
        stage['signal'], stage['distance_mm'], c=stage['light'], cmap='cividis', s=12, zorder=2
    )
    for name, colour, style, label in (
        ('truth_mm', _TRUTH, '-', 'truth'),
        ('range_mm', _OURS, '--', 'background taken off'),
        ('mean_mm', _PAPER, ':', 'mean of all'),
        ('wall_mm', '0.5', '-.', 'wall'),
    ):
        scatter.axhline(stage[name], color=colour, linestyle=style, label=label)
    scatter.set_xlabel('signal [kcps/SPAD]')
    scatter.set_ylabel('range as reported [mm]')
    scatter.set_ylim(stage['truth_mm'] - 60, max(stage['distance_mm']) + 380)
    scatter.legend(loc='upper right', **_SMALL)
    columns = stage['columns']
    half = stage['pitch'] * columns / 2
    amplitude = np.array(stage['amplitude']).reshape(-1, columns)
    shares.imshow(amplitude, cmap='Blues', extent=(-half, half, half, -half), vmin=0)
    for index, value in enumerate(stage['amplitude']):
        row, column = divmod(index, columns)
        x, y = (stage['pitch'] * (step - (columns - 1) / 2) for step in (column, row))
        dark = value > amplitude.max() / 2
        shares.text(x, y + 0.08, f'{value:.1f}', ha='center', color='w' if dark else 'k', **_SMALL)
    truth, position = np.array(stage['truth_m']), np.array(stage['position_m'])
    shares.plot(*(truth[:2] / truth[2]), 'x', color=_TRUTH, markersize=9, markeredgewidth=2)
    shares.plot(*(position[:2] / position[2]), '+', color='black', markersize=9)
    ticks = stage['pitch'] * (np.arange(columns + 1) - columns / 2)
    shares.set_xticks(ticks, [f'{tick:.2f}' for tick in ticks])
    shares.set_yticks(ticks, [f'{tick:.2f}' for tick in ticks])
    shares.set_xlabel('x/z')
    shares.set_ylabel('y/z')
    shares.set_title('modulation of zones\n[kcps/SPAD]', fontsize=9)
    covariance = np.array(stage['covariance_mm2'])
    for panel, axes, name in ((above, (0, 2), 'from above'), (beside, (2, 1), 'from the side')):
        x, y = 1e3 * position[list(axes)]
        outline = _ellipse(covariance, axes)
        panel.fill(x + outline[0], y + outline[1], color=_OURS, alpha=0.2, linewidth=0)
        panel.plot(x, y, '+', color='black', markersize=9, label='said')
        true = 1e3 * truth[list(axes)]
        panel.plot(*true, 'x', color=_TRUTH, markersize=9, markeredgewidth=2, label='true')
        panel.set_title(f'{name}, with the\n95 % ellipsoid', fontsize=9)
        panel.set_xlabel(f'{"xyz"[axes[0]]} [mm]')
        panel.set_ylabel(f'{"xyz"[axes[1]]} [mm]')
        panel.set_aspect('equal', adjustable='datalim')
        panel.legend(loc='upper right', **_SMALL)
    beside.invert_yaxis()


def draw_paper(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the paper's likelihood and bits, and one packet that it takes up late."""
    stage, example = figures['paper'], figures['mislock']['example']
    likelihood, bits, late = panels(figure, "9  The paper's chain, and its trap", (1, 1, 1.1))
    likelihood.plot(stage['time_s'], stage['likelihood'], color=_PAPER)
    likelihood.axhline(stage['threshold'], color='0.4', linestyle='--', label='threshold')
    likelihood.axvline(stage['start_s'], color=_TRUTH, linestyle=':', label='arg max')
    likelihood.set_xlabel('start that is tried [s]')
    likelihood.set_ylabel('likelihood l')
    likelihood.set_title(f'ID {figures["marker"]["id"]}: samples of stage 1', fontsize=9)
    likelihood.legend(loc='upper left', **_SMALL)
    sent = np.array(figures['bits']['bits'])
    signal = np.array(stage['bit_signal'])
    for bit, colour in ((1, _DARK), (0, _BRIGHT)):
        own = np.flatnonzero(sent == bit)
        bits.bar(own, signal[own], color=colour, edgecolor='0.3', linewidth=0.5)
    bits.axhline(stage['d'] + stage['c'] / 2, color=_PAPER, linestyle='--', label='d + c/2')
    bits.set_xlabel('bit')
    bits.set_ylabel('mean of its two samples\n[kcps/SPAD]')
    bits.set_ylim(0, 1.25 * signal.max())
    bits.set_title('dark is what is below the dashed line', fontsize=9)
    bits.legend(loc='upper right', **_SMALL)
    since = (np.array(example['time_s']) - example['start_s']) / figures['bit_s']
    late.plot(since, example['likelihood'], color=_PAPER)
    for place, colour, style, name in (
        (0.0, _TRUTH, ':', 'true start'),
        (example['late_bits'], _LIMIT, '--', 'arg max'),
    ):
        late.axvline(place, color=colour, linestyle=style, label=name)
    top = max(example['likelihood'])
    shown = [bit for index, bit in enumerate(example['bits']) if index < since[-1]]
    _strip(late, shown, 1.12 * top, 0.14 * top)
    late.set_xlim(since[0], since[-1])
    late.set_xticks(range(-8, 13, 2))
    late.set_ylim(0, 1.3 * top)
    late.set_xlabel('start that is tried, in bits (above: what was sent)')
    late.set_ylabel('likelihood l')
    late.set_title(f'ID {example["id"]} is read as {example["read_id"]}', fontsize=9)
    late.legend(loc='center left', **_SMALL)


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
