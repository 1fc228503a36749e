# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each stage of the default detector makes of one packet in one zone."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.detector.candidates import Candidates
from retrolidar_ros.detector.evidence import NoiseLaw, nats
from retrolidar_ros.detector.fit import Fit, fit_candidates
from retrolidar_ros.detector.judge import MOST_RESIDUAL, Reading
from retrolidar_ros.detector.placement import amplitudes
from retrolidar_ros.detector.ranging import BRIGHT, modulated_range
from retrolidar_ros.detector.search import PACKET_SAMPLES, Demand, JointSearch
from retrolidar_ros.detector.soft_bits import SILENT_BITS, Level
from retrolidar_ros.detector.starts import EIGHTHS
from retrolidar_ros.detector.template import packet_light
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.window import placed
from retrolidar_ros.evaluation.chain.played import Played, only_zone, rounded
from retrolidar_ros.evaluation.live import place_error
from retrolidar_ros.frame import Floats

_EIGHTH_S = BIT_PERIOD_S / EIGHTHS
_BINS = np.arange(-1.0, 1.0001, 0.02)
_TOP_IDS = 8
_LIT_BITS = 9
"""Of the packet whose light is drawn in steps of a millisecond."""


class Found(NamedTuple):
    """A packet as the search has found it, fitted, and judged."""

    candidate: Candidates
    """One, in the view of its zone alone."""
    demand: Demand
    fit: Fit
    """In its zone alone."""
    reading: Reading
    """In all zones that saw it."""


def find(played: Played) -> Found:
    """Search what ended with the last frame, fit it and judge it, as the detector has done.

    Raises
    ------
    ValueError
        If the search finds nothing.
    """
    view = played.view()
    until_s, last_s = view.end_s[-2:].tolist()
    ends_s = _EIGHTH_S * np.arange(
        math.floor(until_s / _EIGHTH_S) + 1, math.floor(last_s / _EIGHTH_S) + 1
    )
    demand = played.demand(view)
    search = JointSearch(played.bank, BIT_PERIOD_S)
    candidate = search.ended(view, ends_s, np.ones((len(ends_s), 1), dtype=bool), demand)
    if candidate is None:
        raise ValueError('the search does not find what was read')
    fit = _fitted(played, view, candidate)
    return Found(candidate, demand, fit, played.judged(only_zone(candidate, played.zone)))


def _fitted(played: Played, view: View, candidate: Candidates) -> Fit:
    """Fit one packet to what the zone saw."""
    return fit_candidates(
        candidate,
        view.begin_s,
        view.end_s,
        view.signal.T,
        view.weight.T,
        view.ceiling.T,
        NoiseLaw(),
        played.noise_scale,
    )


def _level(view: View, start_s: float, bit_s: float, still: bool) -> tuple[Level, float, int]:
    """Return the soft bits of a packet, their phase, and over how many samples the mean goes."""
    edges_s = start_s + bit_s * np.arange(PACKET_BITS + 1)
    soft = view.soft_bits(edges_s[None], SILENT_BITS * BIT_PERIOD_S)
    samples = PACKET_SAMPLES + 2 * SILENT_BITS if still else PACKET_SAMPLES
    return soft.steady(0 if still else 1), float(soft.phase[0]), samples


def all_correlations(
    played: Played, view: View, start_s: float, bit_s: float, still: bool
) -> Floats:
    """Return the normalised correlation of every ID with one stretch, shape (ids,)."""
    level, phase, samples = _level(view, start_s, bit_s, still)
    explained = played.bank.correlations(level.value[:, :, 0], phase, samples)[0]
    energy = float(level.energy[0, 0] * level.told[0, 0]) / samples
    correlation: Floats = explained / np.sqrt(energy)
    return correlation


def samples_stage(played: Played) -> dict[str, Any]:
    """Return what the sensor says of the zone."""
    samples, zone = played.samples, played.zone
    step_s = np.diff(samples.time_s)
    return {
        'zone': zone,
        'time_s': rounded(samples.time_s, 4),
        'signal': rounded(samples.signal[:, zone], 2),
        'distance_m': rounded(samples.distance[:, zone], 4),
        'status': played.recording.status[: played.frames, zone].tolist(),
        'step_ms': float(np.round(1e3 * step_s.mean(), 2)),
        'step_stddev_ms': float(np.round(1e3 * step_s.std(), 2)),
    }


def bits_stage(played: Played, found: Found) -> dict[str, Any]:
    """Return the packet, and how its light looks continuously and in exposures."""
    fit, samples = found.fit, played.samples
    start_s, bit_s = float(fit.start_s[0]), float(fit.bit_s[0])
    bits = packet(found.candidate.ids)
    begin_s = start_s + bit_s * np.arange(-1, _LIT_BITS, 0.001 / bit_s)
    lone = np.array([False])
    fine = packet_light(bits, fit.start_s, fit.bit_s, lone, begin_s, begin_s + 1e-6)
    near = (samples.end_s > begin_s[0]) & (samples.begin_s < begin_s[-1])
    begins_s, ends_s = samples.begin_s[near], samples.end_s[near]
    seen = packet_light(bits, fit.start_s, fit.bit_s, lone, begins_s, ends_s)
    phase = _level(played.view(), start_s, bit_s, bool(found.candidate.still[0]))[1]
    return {
        'bits': bits[0].tolist(),
        'start_s': round(start_s, 4),
        'bit_ms': round(1e3 * bit_s, 3),
        'time_s': rounded(begin_s, 4),
        'light': rounded(fine.mean[0], 3),
        'begin_s': rounded(begins_s, 4),
        'end_s': rounded(ends_s, 4),
        'exposed': rounded(seen.mean[0], 3),
        'phase': round(phase, 2),
    }


def soft_stage(played: Played, found: Found) -> dict[str, Any]:
    """Return the soft bits of the packet where the fit has put it."""
    fit, bits = found.fit, packet(found.candidate.ids)[0]
    level, _, _ = _level(
        played.view(), float(fit.start_s[0]), float(fit.bit_s[0]), bool(found.candidate.still[0])
    )
    value = level.value[0, :, 0]
    return {
        'value': rounded(value, 2),
        'dark_mean': round(float(value[bits == 1].mean()), 1),
        'bright_mean': round(float(value[bits == 0].mean()), 1),
    }


def search_stage(played: Played, found: Found) -> dict[str, Any]:
    """Return the best correlation of any ID at every start, and of every ID at the best one."""
    everything = played.view(placed(played.recording, len(played.recording), BIT_PERIOD_S))
    search = JointSearch(played.bank, BIT_PERIOD_S)
    first = (SILENT_BITS + PACKET_BITS + 1) * EIGHTHS
    ends_s = _EIGHTH_S * np.arange(first, math.floor(everything.end_s[-1] / _EIGHTH_S))
    anything = Demand(0.0, found.demand.noise)
    starts_s, found_there = [], []
    for end_s in ends_s:
        one = search.ended(everything, np.array([end_s]), np.ones((1, 1), dtype=bool), anything)
        if one is not None:
            starts_s.append(float(end_s) - PACKET_BITS * BIT_PERIOD_S)
            found_there.append(one)
    candidate = found.candidate
    start_s, bit_s = float(candidate.start_s[0]), float(candidate.bit_s[0])
    still = bool(candidate.still[0])
    view = played.view()
    correlation = all_correlations(played, view, start_s, bit_s, still)
    silent = all_correlations(played, view, start_s - PACKET_BITS * bit_s, bit_s, still)
    order = np.argsort(-correlation)[:_TOP_IDS]
    own = packet(candidate.ids)
    distance = (packet(played.bank.ids[order]) != own).sum(axis=1)
    likelihood = nats(correlation[order], np.asarray(found.fit.samples[0]))
    best = np.array([one.correlation[0] for one in found_there])
    right = np.array([one.ids[0] for one in found_there]) == played.marker.id
    wrong = int(np.where(right, -1.0, best).argmax())
    return {
        'start_s': rounded(starts_s, 4),
        'best': rounded(best, 3),
        'right': right.astype(int).tolist(),
        'most_of_wrong': round(float(best[wrong]), 3),
        'wrong_id': int(found_there[wrong].ids[0]),
        'wrong_residual': round(
            float(_fitted(played, everything, found_there[wrong]).residual[0]), 1
        ),
        'wrong_bits_late': round((starts_s[wrong] - played.truth_start_s) / bit_s, 1),
        'id': int(candidate.ids[0]),
        'correlation': round(float(candidate.correlation[0]), 3),
        'coarse_start_s': round(start_s, 4),
        'threshold': round(found.demand.correlation, 3),
        'chance': float(f'{played.chance[0]:.2g}'),
        'bins': rounded(_BINS, 2),
        'ids_at_start': np.histogram(correlation, _BINS)[0].tolist(),
        'ids_in_silence': np.histogram(silent, _BINS)[0].tolist(),
        'most_in_silence': round(float(silent.max()), 3),
        'top_ids': played.bank.ids[order].tolist(),
        'top_correlation': rounded(correlation[order], 3),
        'top_nats': rounded(likelihood, 1),
        'top_distance': distance.tolist(),
    }


def fit_stage(played: Played, found: Found) -> dict[str, Any]:
    """Return the fitted packet beside the samples, and what it leaves over."""
    fit, samples = found.fit, played.samples
    rows = fit.weight[0] > 0
    left = samples.signal[rows, played.zone] - fit.expected[0, rows]
    return {
        'time_s': rounded(samples.time_s[rows], 4),
        'signal': rounded(samples.signal[rows, played.zone], 2),
        'expected': rounded(fit.expected[0, rows], 2),
        'normalised': rounded(left / np.sqrt(fit.variance[0, rows]), 2),
        'start_error_ms': round(1e3 * (float(fit.start_s[0]) - played.truth_start_s), 2),
        'coarse_start_error_ms': round(
            1e3 * (float(found.candidate.start_s[0]) - played.truth_start_s), 2
        ),
        'bit_error_percent': round(
            100 * (float(fit.bit_s[0]) / BIT_PERIOD_S / (1 + played.marker.clock_error) - 1), 3
        ),
        'gain': round(float(fit.gain[0]), 1),
        'dark': round(float(fit.dark[0]), 1),
        'deviation': round(float(fit.deviation[0]), 2),
        'snr_db': round(20 * math.log10(float(fit.gain[0] / fit.deviation[0])), 1),
        'score': round(float(fit.score[0]), 3),
        'residual': round(float(fit.residual[0]), 2),
        'noise_scale': round(played.noise_scale, 2),
    }


def evidence_stage(played: Played, found: Found) -> dict[str, Any]:
    """Return what the judge measures, its limits, and what it has refused before."""
    reading = found.reading
    tests, fit = reading.tests, reading.fit
    return {
        'zones': list(reading.zones),
        'nats': round(tests.nats, 1),
        'least_nats': round(tests.least_nats, 1),
        'zone_nats': round(float(found.fit.nats[0]), 1),
        'residual': round(float(fit.residual[0]), 2),
        'most_residual': MOST_RESIDUAL,
        'lead': round(tests.lead, 1),
        'least_lead': round(tests.least_lead, 1),
        'corrected_bits': reading.corrected_bits,
        'refused': played.refused,
        'score': round(float(fit.score[0]), 3),
    }


def place_stage(played: Played, found: Found) -> dict[str, Any]:
    """Return where the marker is, and what of the samples says so."""
    grid, samples, zone = played.recording.grid, played.samples, played.zone
    fit, place = found.reading.fit, played.detection.place
    start_s = float(fit.start_s[0])
    end_s = start_s + PACKET_BITS * float(fit.bit_s[0])
    within = (samples.end_s > start_s) & (samples.begin_s < end_s)
    light, told = fit.light[0][within], fit.weight[0][within] > 0
    signal, distance = samples.signal[within], samples.distance[within]
    weight = samples.weight[within] * told[:, None]
    measured = modulated_range(
        light, weight[:, zone], signal[:, zone], distance[:, zone], zone, grid
    )
    if measured is None:
        raise ValueError('the marker was read, but its distance was not')
    amplitude, _ = amplitudes(light, weight, signal)
    truth_m = np.array(played.marker.position_m)
    per_depth = 1e3 / float(grid.z_per_range[zone])
    wrong = place_error(place, truth_m[None])
    covariance = place.covariance[:3, :3]
    bright = light > BRIGHT
    return {
        'light': rounded(light, 3),
        'signal': rounded(signal[:, zone], 2),
        'distance_mm': rounded(per_depth * distance[:, zone], 1),
        'wall_mm': round(per_depth * played.scene.surfaces[0].distance_m, 1),
        'truth_mm': round(1e3 * float(np.linalg.norm(truth_m)), 1),
        'mean_mm': round(per_depth * float(np.nanmean(distance[:, zone])), 1),
        'bright_mean_mm': round(per_depth * float(np.nanmean(distance[bright, zone])), 1),
        'range_mm': round(1e3 * measured[0], 1),
        'range_stddev_mm': round(1e3 * measured[1], 1),
        'range_error_mm': round(1e3 * measured[0] - 1e3 * float(np.linalg.norm(truth_m)), 1),
        'amplitude': rounded(amplitude, 2),
        'columns': grid.columns,
        'pitch': round(grid.pitch, 5),
        'truth_m': rounded(truth_m, 4),
        'position_m': rounded(place.position_m, 4),
        'covariance_mm2': [rounded(row, 2) for row in 1e6 * covariance],
        'deviations_mm': rounded(1e3 * np.sqrt(np.linalg.eigvalsh(covariance)), 1),
        'position_error_mm': round(1e3 * wrong.position_m, 1),
        'bearing_error_deg': round(wrong.bearing_deg, 2),
        'squared_distance': round(wrong.squared_distance, 2),
    }
