# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What markers and their light are put through. Parts of a stress add up."""

from __future__ import annotations

import math
from dataclasses import dataclass

from retrolidar_ros.scene.description import Occlusion
from retrolidar_ros.scene.reference import RESPONSE


@dataclass(frozen=True)
class Stress:
    """What a recording is put through; what is not named is harmless."""

    name: str
    sway: float = 0.0
    """The marker's light rises and falls by this share of it."""
    sway_s: float = 1.0
    """Period of that [s]."""
    second: float = 0.0
    """Light of another marker in the same place that repeats, over that of the first."""
    occlusion: Occlusion | None = None
    wander: float = 0.0
    """How far the wall's signal walks in `WANDER_S`, as a share of the bright signal."""
    pedestal: float = 0.0
    """Signal that is added everywhere [kcps/SPAD]."""
    glass: float = 0.0
    """Signal of a cover glass, which the sensor separates [kcps/SPAD]."""
    neighbour: float = 0.0
    """Ambient light of another sensor while that sends [kcps/SPAD]."""
    clip: float = math.inf
    """No signal is above this share of marker and wall."""
    far_wall: float = 0.0
    """Signal of a wall that the sensor separates, over that of marker and near wall."""
    hand_s: float = 0.0
    """How long a hand hides the marker, in the middle of each packet [s]."""
    clock_error: float = 0.0
    """Relative error of the marker's bit period."""
    jitter_s: float = 0.0
    """Standard deviation of the time of an exposure, whose stamp is true [s]."""
    bright_s: float = RESPONSE.bright_s
    """Time in which the liquid crystal brightens [s]."""
    noise: float = 1.0
    """Variance of the signal over that of the reference."""
    no_target: float = 0.0
    """Share of the dark samples that are reported as no target."""
    abnormal: float = 0.0
    """Share of samples with an abnormal status and meaningless values."""
    lost: float = 0.0
    """Share of frames that never arrive."""


PLAIN = Stress('plain')
STRESSES = (
    PLAIN,
    Stress('sways ±50 % in 2.6 s', sway=0.5, sway_s=2.6),
    Stress('sways ±50 % in 0.9 s', sway=0.5, sway_s=0.9),
    *(Stress(f'second marker {share:.0%}', second=share) for share in (0.1, 0.25, 0.5, 0.7)),
    Stress('clipped at 70 %', clip=0.7),
    Stress('wall wanders', wander=0.1),
    Stress('clock -3 %', clock_error=-0.03),
    Stress('clock +3 %', clock_error=0.03),
    Stress('brightens in 20 ms', bright_s=0.020),
    Stress('pedestal of 40', pedestal=40.0),
    Stress('20 % lost', lost=0.2),
    Stress('20 % abnormal', abnormal=0.2),
    Stress('half of dark no target', no_target=0.5),
    Stress('hand for 250 ms', hand_s=0.25),
    Stress('occluded as drone', occlusion=Occlusion(every_s=1.7, lasting_s=0.06)),
    Stress('noise variance / 8', noise=1 / 8),
    Stress('noise variance × 8', noise=8.0),
    Stress('sways ±25 % in 2.6 s', sway=0.25, sway_s=2.6),
    Stress('sways ±25 % in 0.9 s', sway=0.25, sway_s=0.9),
)
