# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stresses that grow, each from harmless to what no reading survives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from evaluation.bench.stresses import PLAIN, Stress
from retrolidar_ros.scene.description import Occlusion


@dataclass(frozen=True)
class Panel:
    """One stress and how it is swept, from harmless on."""

    name: str
    title: str
    axis: str
    """Of the values, with their unit."""
    values: tuple[float, ...]
    stress: Callable[[float], Stress]


def _panel(name: str, title: str, axis: str, values: str, scale: float, **fixed: Any) -> Panel:
    """Return a panel of the stress's field that is None in `fixed`, in `scale` of the values."""
    (field,) = (key for key, value in fixed.items() if value is None)

    def stress(value: float) -> Stress:
        return replace(PLAIN, **{**fixed, field: scale * value})

    return Panel(name, title, axis, tuple(map(float, values.split())), stress)


def _rotor(percent: float) -> Stress:
    """Return a blade that hides the marker for a share of each fifth of a second."""
    return replace(PLAIN, occlusion=Occlusion(every_s=0.2, lasting_s=0.2 * percent / 100))


_LOST, _SWAY, _CLOCK = (
    '0 5 10 20 30 40 50 60 75 90',
    '0 10 20 30 40 50 65 80 95',
    '0 .5 1 2 3 4 6 8',
)
_ROTOR = tuple(map(float, (0, 5, 10, 20, 30, 40, 50, 65, 80)))
PANELS = (
    _panel('lost_frames', 'lost frames', 'frames lost [%]', _LOST, 0.01, lost=None),
    _panel('abnormal', 'abnormal samples', 'samples abnormal [%]', _LOST, 0.01, abnormal=None),
    _panel('no_target', 'dark: "no target"', 'of dark samples [%]', _LOST, 0.01, no_target=None),
    _panel('jitter', 'jitter', 'deviation [ms]', '0 1 2 3 4 5 6 8', 1e-3, jitter_s=None),
    _panel('fast', "marker's clock fast", 'bits shorter by [%]', _CLOCK, -0.01, clock_error=None),
    _panel('slow', "marker's clock slow", 'bits longer by [%]', _CLOCK, 0.01, clock_error=None),
    _panel('sway_slow', 'sways in 2.6 s', 'by ± [%]', _SWAY, 0.01, sway=None, sway_s=2.6),
    _panel('sway_fast', 'sways in 0.9 s', 'by ± [%]', _SWAY, 0.01, sway=None, sway_s=0.9),
    _panel('wander', 'wall wanders', 'in 0.5 s [%]', '0 5 10 20 40 60 100', 0.01, wander=None),
    _panel('hand', 'a hand', 'hides for [ms]', '0 42 84 126 210 300 450 600', 1e-3, hand_s=None),
    Panel('rotor', 'a rotor, 5 blades/s', 'hidden [%]', _ROTOR, _rotor),
    _panel(
        'far_wall', 'a wall 1 m behind', 'over marker', '0 .2 .4 .6 .7 .8 .9 1', 1, far_wall=None
    ),
    _panel('second', 'second marker in zone', 'its signal [%]', _SWAY, 0.01, second=None),
    _panel('clip', 'saturates', 'at [%] of the top', '100 90 80 70 55 40 25 10', 0.01, clip=None),
    _panel('noise', 'more noise', 'variance, times', '1 2 3 4 6 8 12 20', 1, noise=None),
)
LABORATORY = (
    _panel('pedestal', 'a bright wall', 'its signal', '0 5 10 20 40 80 300 800', 1, pedestal=None),
    _panel('glass', 'a cover glass', 'its signal', '0 2 4 8 16 50 150 300 340 400', 1, glass=None),
    _panel(
        'neighbour', "another sensor's light", 'while it sends', '0 10 30 100 300 1000 3000', 1,
        neighbour=None,
    ),
)  # fmt: skip
"""In kcps/SPAD."""
