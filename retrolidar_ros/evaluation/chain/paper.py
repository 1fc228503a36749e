# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's chain: likelihood, arg max, threshold, Golay; and where the arg max goes wrong."""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import BIT_PERIOD_S, PACKET_BITS, PREAMBLE, decode, packet
from retrolidar_ros.detector import METHODS, Detection, create_detector
from retrolidar_ros.detector.paper import LIKELIHOOD_THRESHOLD, PaperDetector
from retrolidar_ros.detector.paper.demodulation import PACKET_SAMPLES, threshold_bits
from retrolidar_ros.detector.paper.preamble import PREAMBLE_SAMPLES, SAMPLES_PER_BIT
from retrolidar_ros.evaluation.chain.played import rounded
from retrolidar_ros.evaluation.link import Trial, lone_trial, outcome
from retrolidar_ros.evaluation.reference import marker_in_each_zone
from retrolidar_ros.evaluation.sweep import WAKING_S
from retrolidar_ros.frame import Floats, Recording
from retrolidar_ros.scene.description import Marker, Sensor

_SAMPLE_S = BIT_PERIOD_S / SAMPLES_PER_BIT
_SHOWN = slice(-20, 26)
"""Starts about the true one that are drawn of a mislock."""


class Heard(NamedTuple):
    """What the paper's detector made of a recording; a row of each array is a start."""

    likelihood: Floats
    """Of a preamble that begins with each sample, shape (samples, zones)."""
    c: Floats
    """Channel coefficient [kcps/SPAD], shape (samples, zones)."""
    d: Floats
    """DC offset [kcps/SPAD], shape (samples, zones)."""
    detections: list[Detection]


def hear(recording: Recording) -> Heard:
    """Play a recording to the paper's detector and note the fit of every start."""
    detector = cast(PaperDetector, create_detector('paper', recording.grid))
    likelihood, c, d = np.zeros((3, len(recording), recording.grid.zones))
    detections = []
    for count, frame in enumerate(recording, start=1):
        detections += detector.update(frame)
        start = count - PREAMBLE_SAMPLES
        if start >= 0:
            likelihood[start] = detector.newest.likelihood
            c[start] = detector.newest.c
            d[start] = detector.silent
    return Heard(likelihood, c, d, detections)


class Decided(NamedTuple):
    """A packet decided bit by bit."""

    start: int
    """The sample with which it begins."""
    bits: NDArray[np.uint8]
    """Shape (31,)."""
    id: int
    """-1 where the word was refused."""
    corrected_bits: int


def decide(recording: Recording, heard: Heard, zone: int) -> Decided:
    """Return the packet that begins where the likelihood of a zone is largest."""
    start = int(heard.likelihood[: len(recording) - PACKET_SAMPLES + 1, zone].argmax())
    signal = recording.signal[start : start + PACKET_SAMPLES, [zone]].astype(float)
    bits = threshold_bits(signal, heard.d[start, [zone]], heard.c[start, [zone]])
    word = decode(bits[:, len(PREAMBLE) :])
    return Decided(start, bits[0], int(word.ids[0]), int(word.corrected_bits[0]))


def _start_error_s(recording: Recording, start: int, marker: Marker) -> float:
    """Return how late a packet was taken to begin [s], its first sample begun half of one ago."""
    return float(recording.stamp_ns[start]) * 1e-9 - _SAMPLE_S / 2 - marker.start_s


def paper_stage(recording: Recording, marker: Marker, zone: int) -> dict[str, Any]:
    """Return the paper's chain on a lone packet in one zone."""
    heard = hear(recording)
    decided = decide(recording, heard, zone)
    shown = slice(0, len(recording) - PREAMBLE_SAMPLES)
    rows = slice(decided.start, decided.start + PACKET_SAMPLES)
    sent = packet(marker.id)
    own = next((one for one in heard.detections if one.id == marker.id), None)
    truth_m = float(np.linalg.norm(marker.position_m))
    return {
        'time_s': rounded(recording.stamp_ns[shown] * 1e-9, 4),
        'likelihood': rounded(heard.likelihood[shown, zone], 3),
        'threshold': LIKELIHOOD_THRESHOLD,
        'start_s': round(float(recording.stamp_ns[decided.start]) * 1e-9, 4),
        'start_error_ms': round(1e3 * _start_error_s(recording, decided.start, marker), 1),
        'largest': round(float(heard.likelihood[decided.start, zone]), 2),
        'c': round(float(heard.c[decided.start, zone]), 1),
        'd': round(float(heard.d[decided.start, zone]), 1),
        'bit_signal': rounded(
            recording.signal[rows, zone].reshape(PACKET_BITS, SAMPLES_PER_BIT).mean(axis=1), 2
        ),
        'bits': decided.bits.tolist(),
        'wrong_bits': int(np.count_nonzero(decided.bits != sent)),
        'id': decided.id,
        'corrected_bits': decided.corrected_bits,
        'read': [one.id for one in heard.detections],
        'score': None if own is None else round(own.score, 3),
        'range_error_mm': None if own is None else round(1e3 * (own.place.range_m - truth_m), 1),
    }


def mislock_stage(
    sensor: Sensor, range_m: float, scenes: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Return how often the arg max is late, and one packet of which it made a wrong ID.

    Parameters
    ----------
    sensor : Sensor
    range_m : float
        Of all markers [m].
    scenes : int
        At least so many, of a marker in each zone; more until there is an example.
    rng : numpy.random.Generator
        Where IDs, starts and noise come from.
    """
    packets = continuing = late = late_wrong = wrong = default_right = default_wrong = 0
    example: dict[str, Any] | None = None
    while packets < scenes * sensor.grid.zones or example is None:
        scene = marker_in_each_zone(range_m, rng, start_s=WAKING_S, sensor=sensor)
        trial = lone_trial(scene, rng)
        heard = hear(trial.recording)
        default = outcome(trial, create_detector(METHODS[0], sensor.grid))
        default_right += int(default.right.sum())
        default_wrong += int(default.wrong.sum())
        for zone, marker in enumerate(scene.markers):
            continues = packet(marker.id)[len(PREAMBLE) :][:2].tolist() == [0, 1]
            decided = decide(trial.recording, heard, zone)
            error_bits = _start_error_s(trial.recording, decided.start, marker) / BIT_PERIOD_S
            misread = [
                one.id for one in heard.detections if one.zones[0] == zone and one.id != marker.id
            ]
            packets += 1
            continuing += continues
            wrong += bool(misread)
            if continues and error_bits > 1:
                late += 1
                late_wrong += bool(misread)
                if example is None and misread == [decided.id]:
                    example = _example(trial, heard, zone, decided)
    return {
        'packets': packets,
        'continuing': continuing,
        'late': late,
        'late_wrong': late_wrong,
        'wrong': wrong,
        'default_right': default_right,
        'default_wrong': default_wrong,
        'example': example,
    }


def _example(trial: Trial, heard: Heard, zone: int, decided: Decided) -> dict[str, Any]:
    """Return one packet that was taken up late."""
    recording, marker = trial.recording, trial.scene.markers[zone]
    time_s = recording.stamp_ns * 1e-9
    true = int(np.searchsorted(time_s, marker.start_s))
    rows = slice(true + _SHOWN.start, true + _SHOWN.stop)
    bits = packet(marker.id)
    # The likelihood at the right place, give or take a sample.
    near = heard.likelihood[true - 1 : true + 2, zone]
    return {
        'id': marker.id,
        'bits': bits.tolist(),
        'start_s': round(marker.start_s, 4),
        'read_id': decided.id,
        'read_bits': decided.bits.tolist(),
        'corrected_bits': decided.corrected_bits,
        'taken_start_s': round(float(time_s[decided.start]) - _SAMPLE_S / 2, 4),
        'late_bits': round(_start_error_s(recording, decided.start, marker) / BIT_PERIOD_S, 2),
        'likelihood_taken': round(float(heard.likelihood[decided.start, zone]), 2),
        'likelihood_right': round(float(near.max()), 2),
        'time_s': rounded(time_s[rows] - _SAMPLE_S / 2, 4),
        'likelihood': rounded(heard.likelihood[rows, zone], 3),
        'signal': rounded(recording.signal[rows, zone], 2),
    }
