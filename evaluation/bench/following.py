# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings in which a marker is followed, and what ends its track."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.judging import Step, watch
from evaluation.bench.recordings import HAND_DISTANCE_M, HAND_SIGNAL, Sent, record, signal_at
from evaluation.bench.stresses import PLAIN, Stress
from evaluation.experiments.moving import WAYS
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.methods import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording

_KNOWN_S = 3.0  # markers repeat so long before something happens
_AFTER_S = 2.5


def play(recording: Recording) -> tuple[LikelihoodDetector, list[Step]]:
    """Return a detector that has followed the markers of a recording, and what came with frames."""
    detector = create_detector('joint', recording.grid)
    assert isinstance(detector, LikelihoodDetector)
    return detector, list(watch(detector, recording, follow=True))


def _sent(
    range_m: float,
    duration_s: float,
    rng: np.random.Generator,
    stress: Stress = PLAIN,
    way: str = 'to and fro',
    speed_m_s: float = 0.0,
) -> Sent:
    path = WAYS[way](speed_m_s, range_m, rng)
    how: dict[str, Any] = {'range_m': range_m, 'repeated_s': duration_s, 'path': path}
    return record(stress, signal_at(range_m), rng, **how)


def _spliced(before: Recording, after: Recording, frame: int) -> Recording:
    """Return one recording up to a frame, and another one from there on."""
    arrays = {
        name: np.concatenate([values[:frame], getattr(after, name)[frame:]])
        for name, values in vars(before).items()
        if name != 'grid'
    }
    return replace(before, **arrays)


def _some_frame(rng: np.random.Generator) -> int:
    return round((_KNOWN_S + 1.3 * rng.random()) / SENSOR.period_s)


def _all_bright(recording: Recording, rng: np.random.Generator) -> Recording:
    """Return as many frames, drawn from those in which the marker is bright."""
    signal = recording.signal[:, recording.signal.std(axis=0).argmax()]
    dark, bright = np.quantile(signal, (0.1, 0.9))
    kept = np.flatnonzero(signal > dark + 0.9 * (bright - dark))
    rows = rng.choice(kept, len(signal))
    seen = {name: getattr(recording, name)[rows] for name in ('signal', 'distance', 'status')}
    return replace(recording, **seen)


ENDS = ('vanished', 'other ID', 'stays bright')


def dropped_s(range_m: float, rng: np.random.Generator, *, end: str) -> float | None:
    """Return how long a marker is followed after one of the `ENDS` [s].

    None if it was not followed.
    """
    duration_s = _KNOWN_S + _AFTER_S
    sent = _sent(range_m, duration_s, rng)
    if end == 'other ID':
        after = _sent(range_m, duration_s, rng).recording
    elif end == 'stays bright':
        after = _all_bright(sent.recording, rng)
    else:
        after = record(PLAIN, 1e-6, rng, range_m=range_m, repeated_s=duration_s).recording
    frame = _some_frame(rng)
    _, steps = play(_spliced(sent.recording, after, frame))
    known = [any(one.id == sent.ids[0] for one in step.tracks) for step in steps]
    if not known[frame - 1]:
        return None
    last = next((index for index in range(frame, len(known)) if not known[index]), len(known))
    return (last - frame) * SENSOR.period_s


def goes_on(range_m: float, bits: float, rng: np.random.Generator) -> bool | None:
    """Return whether a track survives a hand that hides the marker for some bits; None as above."""
    sent = _sent(range_m, _KNOWN_S + _AFTER_S, rng)
    frame = _some_frame(rng)
    count = round(bits * BIT_PERIOD_S / SENSOR.period_s)
    recording = sent.recording
    recording.signal[frame : frame + count] = HAND_SIGNAL
    recording.distance[frame : frame + count] = HAND_DISTANCE_M
    detector, steps = play(recording)
    return detector.track_counts.ended == 0 if steps[frame - 1].tracks else None


_STRESSES: dict[str, dict[str, Any]] = {
    'still': {},
    'to and fro, 0.6 m/s': {'speed_m_s': 0.6},
    'across, 0.3 m/s': {'way': 'across the view', 'speed_m_s': 0.3},
    'across, 0.6 m/s': {'way': 'across the view', 'speed_m_s': 0.6},
    'hand, 0.1 s a packet': {'stress': Stress('hand', hand_s=0.1)},
    '10 % lost': {'stress': Stress('lost', lost=0.1)},
}
SCENES = tuple(_STRESSES)


def false_ends(scene: str, duration_s: float, rng: np.random.Generator) -> int:
    """Return how often the track of a marker ends though the marker stays."""
    sent = _sent(rng.uniform(1.0, 2.0), duration_s, rng, **_STRESSES[scene])
    return play(sent.recording)[0].track_counts.ended


Measure = Callable[[np.random.Generator], float | None]


def known_of(measure: Measure, trials: int, rng: np.random.Generator) -> list[float]:
    """Return the results of trials in which the marker was followed."""
    results = [measure(rng) for _ in range(trials)]
    return [float(one) for one in results if one is not None]
