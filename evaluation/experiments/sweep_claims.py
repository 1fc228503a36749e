# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the sweeps of the paper come to, beside the paper's own values."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from evaluation.experiments.sweeps import MOST_BITS, Sweep, end_of, point_of
from evaluation.report.charts import SHADES, WRONG, draw_reads, legend_below, new_chart
from evaluation.report.claims import NOTHING, Claim, Claims, as_text, claim_of
from retrolidar_ros.detector import METHODS

PAPER_REACH_M, PAPER_SURE_M, PAPER_FOUND_M = 2.6, 2.0, 2.8
PAPER_SMALL_M, PAPER_ANGLE_DEG, PAPER_YAW_DEG = 1.3, 25, 50
PAPER_LOSS_M, PAPER_OUTDOORS_M = 0.2, 1.0
PAPER_CLEAN, PAPER_BROKEN = 0.89, 0.48


class Reading(Sweep):
    """Distance, and how many of the bits that were read rightly had been wrong."""

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw shares over distance, and the wrong bits of both methods."""
        figure, ((shares, *bits),) = new_chart(1, 3, 16, 5.6, self._message)
        (points,) = (curve['points'] for curve in figures['curves'].values())
        draw_reads(shares, points)
        places = [point['place'] for point in points]
        found = [100 * point['paper']['found'] for point in points]
        shares.plot(places, found, color='0.3', linestyle='-.', linewidth=1)
        shares.axvline(PAPER_REACH_M, color='0.2', linestyle=':')
        shares.set_ylabel('lone packets [%]')
        shares.set_title('identified', fontsize=12)
        for axis, method in zip(bits, METHODS, strict=True):
            below = np.zeros(len(points))
            for wrong in range(MOST_BITS + 1):
                read = np.array(
                    [
                        100 * point[method]['bits'][wrong] / point[method]['right']['trials']
                        for point in points
                    ]
                )
                label = f'{wrong}' if wrong < MOST_BITS else f'{MOST_BITS} or more'
                axis.bar(range(len(places)), read, 0.8, below, color=SHADES[wrong], label=label)
                below += read
            axis.set_xticks(range(len(places)), [f'{place:g}' for place in places])
            axis.set_ylim(0, 103)
            axis.set_title(f'{method}: wrong bits of what is read rightly', fontsize=12)
            axis.grid(axis='x', visible=False)
        bits[1].legend(title='wrong bits', fontsize=10, framealpha=1, loc='upper right')
        for axis in (shares, *bits):
            axis.set_xlabel(self._axis)
        others: dict[str, Any] = {
            **WRONG,
            'paper: preamble found': {'color': '0.3', 'linestyle': '-.'},
            "80 % of the paper's own": {'color': '0.2', 'linestyle': ':'},
        }
        legend_below(figure, METHODS, others)
        return figure


def _ends(figures: dict[str, Any], curve: str) -> list[float | None]:
    return [end_of(figures, curve, method) for method in reversed(METHODS)]


def _reaches(ends: Sequence[float | None], least: float, unit: str = 'm', digits: int = 2) -> Claim:
    """Return a claim that agrees if the default reaches as far as the paper."""
    default = ends[-1]
    words = (as_text(one, unit, digits) for one in ends)
    return claim_of(words, default is not None and default >= least)


def _shares(values: Sequence[float | None], agrees: bool | None = None) -> Claim:
    words = (NOTHING if value is None else f'{value:.0%}' for value in values)
    return claim_of(words, agrees)


def reading_claims(figures: dict[str, Any]) -> Claims:
    """Return the claims of distance, detection and wrong bits."""
    near, sure, far = (
        point_of(figures, '3 cm', place) for place in (1.0, PAPER_SURE_M, PAPER_FOUND_M)
    )

    def of(point: Mapping[str, Any], key: str) -> list[float]:
        return [point[method][key]['rate'] for method in reversed(METHODS)]

    def clean(point: Mapping[str, Any]) -> list[float]:
        bits = [point[method]['bits'] for method in reversed(METHODS)]
        return [one[0] / max(1, sum(one)) for one in bits]

    found = [far[method]['found'] for method in reversed(METHODS)]
    broken = [1 - one for one in clean(far)]
    read = of(sure, 'right')
    return {
        'reach': _reaches(_ends(figures, '3 cm'), PAPER_REACH_M),
        'sure': _shares(read, read[1] > 0.98),
        'found': _shares(found, found[0] > 0.98),
        'wrong': _shares(of(near, 'wrong')),
        'clean': _shares(clean(sure), abs(clean(sure)[0] - PAPER_CLEAN) < 0.06),
        'broken': _shares(broken, abs(broken[0] - PAPER_BROKEN) < 0.08),
    }


def reach_claims(figures: dict[str, Any]) -> Claims:
    """Return the claims of small markers and several packets."""
    point = point_of(figures, '3 cm, 3 packets', PAPER_FOUND_M)
    three = [point[method]['right']['rate'] for method in reversed(METHODS)]
    return {
        'small': _reaches(_ends(figures, '1 cm, one packet'), PAPER_SMALL_M),
        'three': _shares(three, three[1] > 0.97),
    }


def size_claims(figures: dict[str, Any]) -> Claims:
    """Return the claims of how reach grows with area."""
    known = [(float(name.split()[0]), end_of(figures, name, 'joint')) for name in figures['curves']]
    areas, ends = np.array([one for one in known if one[1] is not None], dtype=float).T
    power = float(np.polyfit(np.log(areas), np.log(ends), 1)[0])
    paper = math.log(PAPER_REACH_M / PAPER_SMALL_M) / math.log(9)
    return {'power': Claim(default=f'{power:.2f}', agrees=abs(power - paper) < 0.03)}


def angle_claims(figures: dict[str, Any]) -> Claims:
    """Return the claims of the view."""
    return {'angle': _reaches(_ends(figures, 'at 1 m'), PAPER_ANGLE_DEG, '°', 1)}


def yaw_claims(figures: dict[str, Any]) -> Claims:
    """Return the claims of markers that are turned."""
    return {'yaw': _reaches(_ends(figures, 'at 1 m'), PAPER_YAW_DEG, '°', 1)}


def ambient_claims(figures: dict[str, Any]) -> Claims:
    """Return the claims of light."""
    dark, day, shade = (
        _ends(figures, light) for light in ('dark', 'daylight in a room', 'shade outdoors')
    )
    lost = [
        None if before is None or after is None else before - after
        for before, after in zip(dark, day, strict=True)
    ]
    near = lost[1] is not None and abs(lost[1] - PAPER_LOSS_M) < 0.1
    return {
        'loss': claim_of(map(as_text, lost), near),
        'outdoors': _reaches(shade, PAPER_OUTDOORS_M),
    }
