# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What it gives, and costs, to name the only IDs that may come.

Run it from the repository's root: `PYTHONPATH=. python3 benchmarks/bench_registered.py`. It prints,
without registered IDs and with 64 and 3, how many single packets are read over the link, how many
of markers that are not registered are read as one that is, and, with `--restless-hours`, how many
IDs are read of restless scenes without a marker, three quarters of an hour of which take half an
hour to compute.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from dataclasses import replace

# Threads only get in each other's way in products of this size.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np

from evaluation.bench.disturbances import restless_blocks
from evaluation.bench.rates import frequency
from evaluation.bench.recordings import Sent, record
from evaluation.bench.stresses import PLAIN
from retrolidar_ros.detector import Detector, create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS, choose_ids
from retrolidar_ros.scene.marker_budget import needed_swing
from retrolidar_ros.scene.noise import noisy
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Recording

SCENES = {64: 6, 3: 16}
LINKS_DB = {64: (5.0, 6.0, 7.0, 8.0, 9.0), 3: (4.0, 5.0, 6.0, 7.0, 8.0)}
# Three markers stand apart: zones that see the same ID side by side would add up.
ZONES = {64: tuple(range(16)), 3: (0, 6, 13)}
STRANGER_SCENES = 6
STRANGER_LINKS_DB = (6.0, 8.0, 10.0, 14.0, 20.0)


def detector(registered: Sequence[int] | None) -> Detector:
    """Return a new detector of the default method."""
    return create_detector('joint', SENSOR.grid, registered_ids=registered)


def alone(sent: Sent, zones: Sequence[int], rng: np.random.Generator) -> Recording:
    """Return a recording with the markers of some zones only: walls in the others."""
    wall = noisy(np.full(sent.recording.signal.shape, WALL_SIGNAL), NOISE, rng)
    wall[:, list(zones)] = sent.recording.signal[:, list(zones)]
    return replace(sent.recording, signal=wall.astype(np.float32))


def compare_links(count: int, rng: np.random.Generator) -> None:
    """Print how many are read with `count` registered IDs and with none, of the same frames."""
    known, zones = choose_ids(count)[0], ZONES[count]
    for snr_db in LINKS_DB[count]:
        read = [0, 0]  # free, and registered
        for _ in range(SCENES[count]):
            # Of few IDs the markers of other zones are strangers, which walls then hide.
            others = np.setdiff1d(USABLE_IDS, known)[: SENSOR.grid.zones]
            own = known if count >= SENSOR.grid.zones else others
            sent = record(PLAIN, needed_swing(snr_db), rng, own)
            told = dict(zip(zones, sent.ids[list(zones)].tolist(), strict=True))
            allowed = known.tolist() if count >= SENSOR.grid.zones else list(told.values())
            frames = alone(sent, zones, rng)
            for index, ids in enumerate((None, sorted(allowed))):
                readings = detector(ids).update_all(frames)
                read[index] += len({(one.zones[0], one.id) for one in readings} & {*told.items()})
        total = SCENES[count] * len(zones)
        print(f'{snr_db:4.0f} dB: {read[0]} of {total} free, {read[1]} with {count} registered')


def count_strangers(rng: np.random.Generator) -> None:
    """Print how many packets of markers that are not registered are read as one that is."""
    for snr_db in STRANGER_LINKS_DB:
        misread = dict.fromkeys(SCENES, 0)
        for _ in range(STRANGER_SCENES):
            sent = record(PLAIN, needed_swing(snr_db), rng, USABLE_IDS)
            there = set(sent.ids.tolist())
            for count in misread:
                absent = sorted(set(choose_ids(count)[0].tolist()) - there)
                misread[count] += len(detector(absent).update_all(sent.recording))
        told = ', '.join(f'{wrong} with {count} registered' for count, wrong in misread.items())
        print(f'{snr_db:4.0f} dB: of {STRANGER_SCENES * SENSOR.grid.zones} strangers {told}')


def count_restless(count: int | None, hours: float, rng: np.random.Generator) -> None:
    """Print what is read of restless scenes without a marker, with `count` registered IDs."""
    judge = detector(None if count is None else sorted(choose_ids(count)[0].tolist()))
    ids = [
        reading.id
        for block in restless_blocks(hours * 3600, rng)
        for reading in judge.update_all(block)
    ]
    found = frequency(len(ids), hours)
    print(
        f'{count or "none"} registered: {len(ids)} in {hours:g} h, {found["per_hour"]:.1f} an hour '
        f'({found["low"]:.2g} to {found["high"]:.2g}), IDs {ids}'
    )


def main() -> None:
    """Print all figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--restless-hours', type=float, default=0.0, help='of each (default: 0)')
    hours = parser.parse_args().restless_hours
    rng = np.random.default_rng(1)
    print('single packets read')
    for count in SCENES:
        compare_links(count, rng)
    print('strangers read as registered markers')
    count_strangers(rng)
    if hours > 0:
        print('restless scenes without a marker')
        for registered in (None, *SCENES):
            count_restless(registered, hours, np.random.default_rng(2))


if __name__ == '__main__':
    main()
