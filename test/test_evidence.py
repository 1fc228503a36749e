# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from retrolidar_ros.code import packet
from retrolidar_ros.detector.evidence import (
    NoiseLaw,
    NoiseScale,
    correlation_threshold,
    group_threshold,
    nats,
)
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import Floats

PACKET_SAMPLES = 62
ZONES = 16
LAW = NoiseLaw()


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def samples_of(signal: Floats) -> Samples:
    time_s = (np.arange(len(signal)) + 0.5) * 0.021
    return Samples(
        time_s=time_s,
        signal=signal,
        weight=np.ones_like(signal),
        distance=np.ones_like(signal),
        begin_s=time_s - 0.0105,
        end_s=time_s + 0.0105,
    )


@pytest.mark.parametrize(
    ('overall', 'hypotheses', 'threshold'),
    [(1e-3, 4096 * 5, 0.616), (9e-8, 4096 * 5, 0.737), (9e-8, 64 * 5, 0.690)],
)
def test_the_threshold_has_the_published_values(
    overall: float, hypotheses: int, threshold: float
) -> None:
    least = correlation_threshold(PACKET_SAMPLES, overall / hypotheses)
    assert least == pytest.approx(threshold, abs=0.003)


@pytest.mark.parametrize(('samples', 'chance'), [(10, 0.2), (62, 0.01), (62, 0.3), (94, 0.03)])
def test_white_noise_exceeds_the_threshold_as_often_as_granted(
    samples: int, chance: float, rng: np.random.Generator
) -> None:
    trials = 20_000
    template = rng.integers(0, 2, samples) + rng.uniform(0, 0.1, samples)
    template -= template.mean()
    noise = rng.standard_normal((trials, samples))
    noise -= noise.mean(axis=1, keepdims=True)
    norms = np.linalg.norm(noise, axis=1) * np.linalg.norm(template)
    above = np.count_nonzero(noise @ template / norms > correlation_threshold(samples, chance))
    assert above / trials == pytest.approx(chance, abs=4 * np.sqrt(chance / trials))


def test_the_threshold_rises_as_the_chance_falls_and_falls_with_samples() -> None:
    chances = [0.4, 1e-2, 1e-6, 1e-12]
    thresholds = [correlation_threshold(62, chance) for chance in chances]
    assert thresholds == sorted(thresholds)
    assert correlation_threshold(62, 0.5) == 0
    assert correlation_threshold(496, 1e-9) < correlation_threshold(62, 1e-9)


@pytest.mark.parametrize('threshold', [1.0, 12.5, 30.0])
def test_a_group_of_one_zone_needs_what_a_zone_needs(threshold: float) -> None:
    assert group_threshold(threshold, 1) == threshold


@pytest.mark.parametrize('threshold', [12.5, 30.0])
def test_a_group_of_more_zones_needs_more_but_less_than_each_by_itself(threshold: float) -> None:
    thresholds = [group_threshold(threshold, zones) for zones in range(1, 10)]
    assert (np.diff(thresholds) > 0).all()
    assert thresholds[1] > threshold + 1
    assert all(least < threshold * zones for zones, least in enumerate(thresholds[1:], start=2))


@pytest.mark.parametrize('zones', [2, 3])
def test_chance_reaches_the_threshold_of_a_group_as_often_as_that_of_one(
    zones: int, rng: np.random.Generator
) -> None:
    gain = rng.standard_normal((400_000, zones))
    evidence = (gain**2).sum(axis=1) / 2
    two_deviations = 2.0  # nats
    reached = (gain > 0).all(axis=1) & (evidence > group_threshold(two_deviations, zones))
    assert reached.mean() == pytest.approx(0.02275, rel=0.05)


def test_nats_are_the_logarithm_of_the_likelihood_ratio(rng: np.random.Generator) -> None:
    template = rng.standard_normal(50)
    values = 0.7 * template + rng.standard_normal(50)
    template, values = template - template.mean(), values - values.mean()
    gain = (values @ template) / (template @ template)
    power = np.array([np.mean(values**2), np.mean((values - gain * template) ** 2)])
    likelihood = -25 * (np.log(power) + 1)
    correlation = (values @ template) / np.sqrt((values @ values) * (template @ template))
    assert nats(np.array(correlation), np.array(50)) == pytest.approx(likelihood[1] - likelihood[0])


def test_a_negative_correlation_is_no_evidence() -> None:
    assert nats(np.array([-0.9, -1.0, 0.0]), np.full(3, 62.0)).tolist() == [0.0, 0.0, 0.0]
    assert np.isfinite(nats(np.array([1.0]), np.array([62.0]))).all()


@pytest.mark.parametrize(('floor', 'slope'), [(0.0, 0.2), (-1.0, 0.2), (1.0, -0.1)])
def test_a_law_that_allows_no_noise_is_refused(floor: float, slope: float) -> None:
    with pytest.raises(ValueError, match='the floor must be positive'):
        NoiseLaw(floor, slope)


def test_not_a_number_is_no_noise_law() -> None:
    with pytest.raises(ValueError, match='the floor must be positive'):
        NoiseLaw(float('nan'), 0.2)


@pytest.mark.parametrize('factor', [0.5, 1.0, 2.0])
def test_the_scale_of_the_noise_is_learnt(factor: float, rng: np.random.Generator) -> None:
    scale = NoiseScale(LAW)
    mean = np.linspace(4, 60, ZONES)
    deviation = np.sqrt(factor * LAW.variance(mean))
    for _ in range(40):
        signal = mean + deviation * rng.standard_normal((PACKET_SAMPLES, ZONES))
        scale.learn(samples_of(signal))
    assert scale.value == pytest.approx(factor, rel=0.15)


@pytest.mark.parametrize('amplitude', [30.0, 100.0])
def test_blinking_zones_do_not_pass_for_noise(amplitude: float, rng: np.random.Generator) -> None:
    scale = NoiseScale(LAW)
    ids = rng.integers(1, 4095, ZONES // 2)
    light = np.ones((PACKET_SAMPLES, ZONES))
    light[:, ::2] = 1 - np.repeat(packet(ids), 2, axis=1).T
    mean = 4 + amplitude * light
    for _ in range(40):
        noise = np.sqrt(LAW.variance(mean)) * rng.standard_normal(mean.shape)
        scale.learn(samples_of(mean + noise))
    assert scale.value == pytest.approx(1.0, rel=0.15)


def test_the_scale_is_not_learnt_from_erasures_or_too_few_zones(rng: np.random.Generator) -> None:
    scale = NoiseScale(LAW)
    samples = samples_of(100 * rng.standard_normal((PACKET_SAMPLES, ZONES)))
    erased = samples.weight.copy()
    erased[5] = 0
    scale.learn(samples._replace(weight=erased))
    scale.learn(samples_of(samples.signal[:, :2]))
    assert scale.value == 1.0
