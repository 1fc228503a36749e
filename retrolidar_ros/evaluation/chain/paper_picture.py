# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The picture of stage 9: the paper's chain, and its trap."""

from __future__ import annotations

from typing import Any

import numpy as np

from retrolidar_ros.evaluation.chain.pictures import (
    BRIGHT,
    DARK,
    LIMIT,
    PAPER,
    SMALL,
    TRUTH,
    draw_strip,
    panels,
)


def draw_paper(figure: Any, figures: dict[str, Any]) -> None:
    """Draw the paper's likelihood and bits, and one packet that it takes up late."""
    stage, example = figures['paper'], figures['mislock']['example']
    likelihood, bits, late = panels(figure, "9  The paper's chain, and its trap", (1, 1, 1.1))
    likelihood.plot(stage['time_s'], stage['likelihood'], color=PAPER)
    likelihood.axhline(stage['threshold'], color='0.4', linestyle='--', label='threshold')
    likelihood.axvline(stage['start_s'], color=TRUTH, linestyle=':', label='arg max')
    likelihood.set_xlabel('start that is tried [s]')
    likelihood.set_ylabel('likelihood l')
    likelihood.set_title(f'ID {figures["marker"]["id"]}: samples of stage 1', fontsize=9)
    likelihood.legend(loc='upper left', **SMALL)
    sent = np.array(figures['bits']['bits'])
    signal = np.array(stage['bit_signal'])
    for bit, colour in ((1, DARK), (0, BRIGHT)):
        own = np.flatnonzero(sent == bit)
        bits.bar(own, signal[own], color=colour, edgecolor='0.3', linewidth=0.5)
    bits.axhline(stage['d'] + stage['c'] / 2, color=PAPER, linestyle='--', label='d + c/2')
    bits.set_xlabel('bit')
    bits.set_ylabel('mean of its two samples\n[kcps/SPAD]')
    bits.set_ylim(0, 1.25 * signal.max())
    bits.set_title('dark is what is below the dashed line', fontsize=9)
    bits.legend(loc='upper right', **SMALL)
    since = (np.array(example['time_s']) - example['start_s']) / figures['bit_s']
    late.plot(since, example['likelihood'], color=PAPER)
    for place, colour, style, name in (
        (0.0, TRUTH, ':', 'true start'),
        (example['late_bits'], LIMIT, '--', 'arg max'),
    ):
        late.axvline(place, color=colour, linestyle=style, label=name)
    top = max(example['likelihood'])
    shown = [bit for index, bit in enumerate(example['bits']) if index < since[-1]]
    draw_strip(late, shown, 1.12 * top, 0.14 * top)
    late.set_xlim(since[0], since[-1])
    late.set_xticks(range(-8, 13, 2))
    late.set_ylim(0, 1.3 * top)
    late.set_xlabel('start that is tried, in bits (above: what was sent)')
    late.set_ylabel('likelihood l')
    late.set_title(f'ID {example["id"]} is read as {example["read_id"]}', fontsize=9)
    late.legend(loc='center left', **SMALL)
