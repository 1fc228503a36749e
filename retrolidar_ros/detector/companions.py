# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which neighbouring zones see the same packet, and what they see together."""

from __future__ import annotations

import numpy as np

from retrolidar_ros.detector.evidence import NoiseLaw, nats
from retrolidar_ros.detector.fit import Fit
from retrolidar_ros.detector.view import View
from retrolidar_ros.frame import Floats, ZoneGrid

# A zone next to the one in question joins when chance would make its part once in 300 times.
_LEAST_COMPANION_NATS = 4.5
# Share of what a neighbour sees beyond noise that the packet must explain.
_LEAST_SHARE = 0.5


class Companions:
    """The zones around each zone of a grid."""

    def __init__(self, grid: ZoneGrid) -> None:
        """Tabulate the neighbours, those across a corner too."""
        row, column = np.divmod(np.arange(grid.zones), grid.columns)
        near = (np.abs(np.subtract.outer(row, row)) <= 1) & (
            np.abs(np.subtract.outer(column, column)) <= 1
        )
        np.fill_diagonal(near, False)
        self._near = [np.flatnonzero(row) for row in near]

    def parts(
        self, zone: int, fit: Fit, everything: View, law: NoiseLaw, noise_scale: float
    ) -> tuple[dict[int, float], dict[int, float]]:
        """Return the likelihood ratios [nats] and gains of a template in a zone and around it.

        Parameters
        ----------
        zone : int
            The one in which the template was fitted; it comes first.
        fit : Fit
            Of one candidate.
        everything : View
            Of all zones.
        law : NoiseLaw
            Of the sensor.
        noise_scale : float
            How many times the variance of that law it has.
        """
        zones = np.concatenate([[zone], self._near[zone]])
        signal = everything.signal[:, zones]
        weight = everything.weight[:, zones] * (fit.weight[0] > 0)[:, None]
        told = np.maximum(weight.sum(axis=0), 1.0)
        template = fit.light[0][:, None] - (weight * fit.light[0][:, None]).sum(axis=0) / told
        template = template * weight
        centred = (signal - (weight * signal).sum(axis=0) / told) * weight
        common = np.einsum('nz,nz->z', template, centred)
        power = np.maximum(np.einsum('nz,nz->z', template, template), 1e-9)
        energy = np.maximum(np.einsum('nz,nz->z', centred, centred), 1e-9)
        parts = nats(common / np.sqrt(power * energy), told)
        # Most of what a zone sees beyond noise must be the packet, or it sees something else.
        noise = noise_scale * law.variance(signal.mean(axis=0))
        modulation = energy / told - noise
        parts[1:][(common * common / power / told < _LEAST_SHARE * modulation)[1:]] = 0.0
        seers = zones.tolist()
        return (
            dict(zip(seers, parts.tolist(), strict=True)),
            dict(zip(seers, (common / power).tolist(), strict=True)),
        )


def seeing(zone: int, parts: dict[int, float]) -> list[int]:
    """Return a zone and those around it that see its packet, by their likelihood ratios [nats]."""
    return [seer for seer, part in parts.items() if seer == zone or part > _LEAST_COMPANION_NATS]


def combined(seen: list[int], gains: dict[int, float], everything: View, law: NoiseLaw) -> View:
    """Return the sum of zones in which a packet's amplitude stands out most of their noise.

    It counts as a view of the first of them.
    """
    gain = np.array([gains[seer] for seer in seen])
    mean = (everything.signal[:, seen] * everything.weight[:, seen]).sum(axis=0)
    mean /= np.maximum(everything.weight[:, seen].sum(axis=0), 1.0)
    weights = gain / law.variance(mean)
    # In the scale of a single zone's noise, for which the noise law holds.
    weights /= np.sqrt((weights**2 * law.variance(mean)).sum())
    weights *= np.sqrt(law.variance(mean[0]))
    signal = everything.signal[:, seen] - mean
    total: Floats = (signal @ weights + mean[0])[:, None]
    weight = everything.weight[:, seen].min(axis=1)[:, None]
    return View(
        np.array(seen[:1]),
        everything.begin_s,
        everything.end_s,
        total,
        weight,
        everything.ceiling[:, seen[:1]],
    )
