# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of search, decision and placement that were chosen by hand, halved and doubled."""

import re

from evaluation.bench.changed_core import Part, core_sources

NUMBERS = {
    'bearing.c': ('BLUR_DOUBT', 'SMEARED', 'MODEL_ERROR'),
    'clock.c': ('COST_OF_BIT',),
    'constants.h': (
        *('RL_OVERLAP_BITS', 'RL_MAX_MARGIN', 'RL_AS_GOOD', 'RL_MOST', 'RL_MIN_PART'),
        *('RL_MIN_SEEN', 'RL_BRIGHT', 'RL_PHASES', 'RL_LOOK_BITS'),
    ),
    'decide.c': ('MIN_ALONE',),
    'detector_state.h': ('RL_ACTIVE',),
    'whitened.c': ('Q_OVER_R',),
    'pool.c': ('MAX_MISSED',),
    'ranging.c': ('IN_ZONE', 'BRIGHTEST'),
    'ranging.h': ('RL_BEND_M_S2',),
    'search.h': ('RL_STRONG',),
    'template.c': ('SAME_PHASE_BITS',),
    'window.c': ('MIN_NOISE',),
}
"""By the file that declares them."""


_NUMBER = re.compile(r'(?<![\w.])\d+(?:\.\d*)?(?:e-?\d+)?')


def number_changes() -> dict[str, list[Part]]:
    """Return each number halved, and doubled, by its name and what it becomes.

    Of a share above a half, what it lacks of 1 is halved instead of doubling it. Raises
    ValueError if the core has no such number.
    """
    texts = {path.name: path.read_text(encoding='utf-8') for path in core_sources()}
    changes = {}
    for file, names in NUMBERS.items():
        for name in names:
            declared = rf'\b{name}(?:\[\w+\])? = (\{{[^}}]*\}}|[^,;}}\n]+)'
            found = re.search(declared, texts[f'retrolidar_{file}'])
            if not found:
                raise ValueError(f'retrolidar_{file} has no number {name}')
            for way in (_halved, _doubled):
                line = found[0].replace(found[1], _NUMBER.sub(way, found[1]))
                scalar = _NUMBER.fullmatch(found[1].rstrip('f'))
                became = f'{scalar[0]} to {way(scalar)}' if scalar else way.__name__[1:]
                changes[f'{name} {became}'] = [Part(file, found[0], line)]
    return changes


def _text(value: float, like: str) -> str:
    return f'{value:g}' if '.' in like or 'e' in like else str(max(round(value), 1))


def _halved(number: re.Match[str]) -> str:
    return _text(float(number[0]) / 2, number[0])


def _doubled(number: re.Match[str]) -> str:
    value = float(number[0])
    return _text((1 + value) / 2 if 0.5 < value < 1 else 2 * value, number[0])
