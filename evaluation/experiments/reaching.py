# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far four of five markers are read, from one packet and from several: a quick figure."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.rates import falls_below
from evaluation.bench.setup import Setup, arguments, setup_of, spread
from evaluation.bench.stresses import PLAIN, record
from evaluation.experiments.brighter import judged
from evaluation.experiments.reach import LOOK_S
from evaluation.report.charts import LEVEL
from retrolidar_ros.scene.optics import received_signal
from retrolidar_ros.scene.truth import PACKET_S

_RANGES_M = {
    (0.03, 1): (2.5, 2.7, 2.8, 2.9, 3.0, 3.1, 3.3),
    (0.03, 8): (3.3, 3.5, 3.6, 3.7, 3.8, 3.9, 4.0, 4.2, 4.4),
    (0.01, 1): (1.4, 1.5, 1.55, 1.6, 1.65, 1.7, 1.75, 1.85),
    (0.01, 8): (1.8, 1.9, 2.0, 2.1, 2.2, 2.3, 2.4),
}
"""By edge of the marker [m] and number of packets."""
_DRAWS = 1000


class Case(NamedTuple):
    """Markers of one size at one distance, one in every zone."""

    size_m: float
    packets: int
    range_m: float
    run: int
    setup: Setup


def count(case: Case) -> tuple[int, int, int]:
    """Return how many markers were read, how many there were, and how many IDs were wrong."""
    case_number = round(1000 * case.size_m), case.packets, round(1000 * case.range_m), case.run
    signal = float(received_signal(np.array(case.range_m), case.size_m**2, 0.0))
    sent = record(
        PLAIN,
        signal,
        case.setup.rng(*case_number),
        case.setup.ids,
        range_m=case.range_m,
        repeated_s=None if case.packets == 1 else case.packets * PACKET_S + LOOK_S,
    )
    if case.packets == 1:
        counts = judged(sent, case.setup, max_packets=1)
        return counts.read, counts.packets, counts.wrong
    detector = case.setup.detector(sent.recording.grid, max_packets=case.packets)
    read = np.zeros(len(sent.ids), dtype=bool)
    wrong = 0
    for detection in detector.update_all(sent.recording):
        zones = list(detection.zones)
        own = sent.ids[zones] == detection.id
        read[np.array(zones)[own]] = True
        wrong += not own.any()
    return int(read.sum()), len(read), wrong


def _interval(
    places: list[float], hits: list[int], trials: list[int], rng: np.random.Generator
) -> tuple[float, float]:
    """Return where the level is crossed in 95 % of shares redrawn with the binomial law."""
    # A share of none or all is not certain: half a trial more of either.
    shares = (np.array(hits) + 0.5) / (np.array(trials) + 1)
    redrawn = rng.binomial(trials, shares, (_DRAWS, len(places))) / np.array(trials)
    crossed = [falls_below(LEVEL, places, row) for row in redrawn.tolist()]
    bounds = np.percentile([place for place in crossed if place is not None], (2.5, 97.5))
    return float(bounds[0]), float(bounds[1])


def reach(setup: Setup, size_m: float, packets: int, *, runs: int, jobs: int = 1) -> dict[str, Any]:
    """Return how far four of five are read.

    Parameters
    ----------
    setup : Setup
        Which detector.
    size_m : float
        Edge of the markers [m].
    packets : int
        1 = lone packets; otherwise markers that repeat for a time of so many.
    runs : int
        Recordings of 16 markers at each distance.
    jobs : int
        How many processes.

    Returns
    -------
    dict
        'reach_m' and its bounds 'low_m' and 'high_m' of 95 %, None where the level is not
        crossed; 'points' of distance and share; 'wrong' IDs.
    """
    ranges_m = list(_RANGES_M[size_m, packets])
    cases = [
        Case(size_m, packets, range_m, index, setup)
        for range_m in ranges_m
        for index in range(runs)
    ]
    counts = np.array(spread(count, cases, jobs)).reshape(len(ranges_m), runs, 3).sum(axis=1)
    hits, trials, wrong = counts.T.tolist()
    shares = [part / whole for part, whole in zip(hits, trials, strict=True)]
    found = falls_below(LEVEL, ranges_m, shares)
    low_m, high_m = (
        (None, None) if found is None else _interval(ranges_m, hits, trials, setup.rng())
    )
    return {
        'size_m': size_m,
        'packets': packets,
        'reach_m': found,
        'low_m': low_m,
        'high_m': high_m,
        'points': list(zip(ranges_m, shares, strict=True)),
        'wrong': sum(wrong),
    }


def run(setup: Setup, *, runs: int, jobs: int = 1) -> list[dict[str, Any]]:
    """Return the reach of both sizes, from one packet and from eight."""
    return [reach(setup, *which, runs=runs, jobs=jobs) for which in _RANGES_M]


def summarise(figures: list[dict[str, Any]]) -> str:
    """Return the figures as lines of text."""
    lines = [f'{LEVEL:.0%} are read to (95 %)']
    for row in figures:
        told = (
            'level not crossed'
            if row['reach_m'] is None
            else f'{row["reach_m"]:.2f} m ({row["low_m"]:.2f}–{row["high_m"]:.2f})'
        )
        points = ' '.join(f'{place:g}:{share:.2f}' for place, share in row['points'])
        lines.append(
            f'{100 * row["size_m"]:g} cm, {row["packets"]} packets: {told}, '
            f'{row["wrong"]} wrong IDs;  {points}'
        )
    return '\n'.join(lines)


def main() -> None:
    """Run the experiment and print its figures."""
    told = arguments(__doc__, runs=4).parse_args()
    print(summarise(run(setup_of(told), runs=told.runs, jobs=told.jobs)))


if __name__ == '__main__':
    main()
