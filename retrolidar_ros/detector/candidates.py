# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a search finds, before it is judged."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS
from retrolidar_ros.detector.evidence import nats
from retrolidar_ros.frame import Floats


class Candidates(NamedTuple):
    """Packets that a search has found, each field of shape (candidates,)."""

    zone: NDArray[np.intp]
    ids: NDArray[np.int64]
    start_s: Floats
    """When the frame (preamble and word) starts that lies first in the window, or before it."""
    bit_s: Floats
    begin_s: Floats
    """Of the window in which the packet was looked for, the silence before it included [s]."""
    end_s: Floats
    packets: NDArray[np.int64]
    repeats: NDArray[np.bool_]
    """Whether the window is any stretch of a repeating packet."""
    still: NDArray[np.bool_]
    """Whether nothing but a constant was taken off (`soft_bits`)."""
    correlation: Floats
    """As the search has found it, with coarse templates."""
    rival: Floats
    """The same of the best other ID that the search has found in the zone, 0 without."""

    def at(self, index: NDArray[np.intp] | NDArray[np.bool_]) -> Candidates:
        """Return some of them."""
        fields: dict[str, Any] = {name: values[index] for name, values in self._asdict().items()}
        return Candidates(**fields)


def joined(found: list[Candidates], least: float) -> Candidates | None:
    """Return the best candidate of each zone and packet among all that were found.

    What overlaps by more than half a packet in a zone is the same packet found more than once,
    or a rival. Only what correlates by more than `least` is returned.
    """
    found = [candidates for candidates in found if len(candidates.zone)]
    if not found:
        return None
    together = Candidates(*(np.concatenate(fields) for fields in zip(*found, strict=True)))
    samples = 2 * (together.end_s - together.begin_s) / together.bit_s
    evidence = nats(together.correlation, samples)
    order = np.argsort(-evidence, kind='stable')
    kept: list[int] = []
    rival = np.zeros(len(order))
    for index in order.tolist():
        half_s = together.bit_s[index] * PACKET_BITS / 2
        same = [
            other
            for other in kept
            if together.zone[other] == together.zone[index]
            and abs(together.end_s[other] - together.end_s[index]) <= half_s
        ]
        if not same:
            kept.append(index)
        elif together.ids[index] != together.ids[same[0]] and not rival[same[0]]:
            rival[same[0]] = together.correlation[index]
    best = together._replace(rival=rival).at(np.array(kept, dtype=np.intp))
    best = best.at(best.correlation > least)
    return best if len(best.zone) else None
