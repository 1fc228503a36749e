# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stresses of markers and their light, and panels in which one stress grows."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from retrolidar_ros.scene.description import Occlusion
from retrolidar_ros.scene.reference import RESPONSE


@dataclass(frozen=True)
class Stress:
    """Disturbances of a recording; they add up, and those that are not named are none."""

    name: str
    sway: float = 0.0  # the marker's light rises and falls by this share of it
    sway_s: float = 1.0  # period of that [s]
    second: float = 0.0
    """Light of another marker in the same place that repeats, over that of the first."""
    occlusion: Occlusion | None = None
    wander: float = 0.0
    """How far the wall's signal drifts in `WANDER_S`, as a share of the bright signal."""
    pedestal: float = 0.0  # signal that is added everywhere [kcps/SPAD]
    glass: float = 0.0  # signal of a cover glass, which the sensor separates [kcps/SPAD]
    neighbour: float = 0.0  # ambient light of another sensor while that sends [kcps/SPAD]
    clip: float = math.inf  # no signal is above this share of marker and wall
    far_wall: float = 0.0
    """Signal of a wall that the sensor separates, over that of marker and near wall."""
    hand_s: float = 0.0  # how long a hand hides the marker, in the middle of each packet [s]
    clock_error: float = 0.0  # relative error of the marker's bit period
    jitter_s: float = 0.0  # standard deviation of the time of an exposure, whose stamp is true [s]
    bright_s: float = RESPONSE.bright_s  # time in which the liquid crystal brightens [s]
    noise: float = 1.0  # variance of the signal over that of the reference
    no_target: float = 0.0  # share of the dark samples that are reported as no target
    abnormal: float = 0.0  # share of samples with an abnormal status and meaningless values
    lost: float = 0.0  # share of frames that never arrive


PLAIN = Stress('plain')


@dataclass(frozen=True)
class Panel:
    """One stress and its values, the harmless one first."""

    name: str
    title: str
    axis: str  # of the values, with their unit
    values: tuple[float, ...]
    stress: Callable[[float], Stress]


def _panel(name: str, title: str, axis: str, values: str, scale: float, **fixed: Any) -> Panel:
    """Return a panel of the stress's field that is None in `fixed`, in `scale` of the values."""
    (field,) = (key for key, value in fixed.items() if value is None)

    def stress(value: float) -> Stress:
        return replace(PLAIN, **{**fixed, field: scale * value})

    return Panel(name, title, axis, tuple(map(float, values.split())), stress)


_LOST, _SWAY = '0 5 10 20 30 40 50 60 75 90', '0 10 20 30 40 50 65 80 95'
_CLOCK, _WALL = '0 .5 1 2 3 4 6 8', '0 .2 .4 .6 .7 .8 .9 1'
_SIGNAL, _LIGHT = 'its signal [kcps/SPAD]', '0 10 30 100 300 1000 3000'
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
    Panel(
        'rotor',
        'a rotor, 5 blades/s',
        'hidden [%]',
        (0, 5, 10, 20, 30, 40, 50, 65, 80),
        lambda hidden: replace(PLAIN, occlusion=Occlusion(0.2, 0.002 * hidden)),
    ),
    _panel('far_wall', 'a wall 1 m behind', 'signal [of marker]', _WALL, 1, far_wall=None),
    _panel('second', 'second marker in zone', 'its signal [%]', _SWAY, 0.01, second=None),
    _panel('clip', 'saturates', 'at [%] of the top', '100 90 80 70 55 40 25 10', 0.01, clip=None),
    _panel('noise', 'more noise', 'variance [times]', '1 2 3 4 6 8 12 20', 1, noise=None),
    _panel('pedestal', 'a bright wall', _SIGNAL, '0 5 10 20 40 80 300 800', 1, pedestal=None),
    _panel('glass', 'a cover glass', _SIGNAL, '0 2 4 8 16 50 150 300 340 400', 1, glass=None),
    _panel('neighbour', 'another sensor sends', _SIGNAL, _LIGHT, 1, neighbour=None),
)
