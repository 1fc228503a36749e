# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from harness_core import GRID, PERIOD_S, light_at, noisy, sent
from harness_frames import both_grids, rms
from hypothesis import given
from hypothesis import strategies as st

from retrolidar_ros.core import array, ffi, lib
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.detector.detection import Bearing, place, zone_bearing
from retrolidar_ros.detector.likelihood_detector import core_sensor
from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.scene.optics import zone_shares
from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, Status
from retrolidar_ros.sensor.rotation import matrix_of

SPOT = 0.03  # of a marker of 3 cm in 1 m, as a tangent
POINT = 1e-4


@both_grids
def test_position_is_along_the_bearing_and_orientation_faces_the_sensor(grid: ZoneGrid) -> None:
    for zone, direction in enumerate(grid.directions):
        placed = place(zone_bearing(zone, grid), 1.5, 0.01)
        assert (placed.range_m, placed.range_stddev_m) == (1.5, 0.01)
        assert np.linalg.norm(placed.position_m) == pytest.approx(1.5)
        assert placed.position_m[:2] / placed.position_m[2] == pytest.approx(grid.tangents[zone])
        quaternion = placed.orientation
        assert np.linalg.norm(quaternion) == pytest.approx(1)
        assert matrix_of(quaternion)[:, 2] == pytest.approx(direction)
    ahead = place(Bearing(np.zeros(2), np.full(2, 1e-4)), 1.5, 0.01)
    assert ahead.orientation == pytest.approx([0, 0, 0, 1])


@pytest.mark.parametrize('zone', [0, 5, 15])
@pytest.mark.parametrize('stddev_m', [1e-4, 0.05])
def test_covariance_is_the_mean_square_error_of_such_markers(zone: int, stddev_m: float) -> None:
    rng = np.random.default_rng(1)
    bearing = zone_bearing(zone, GRID)
    placed = place(bearing, 1.5, stddev_m)
    tangents = bearing.tangent + np.sqrt(bearing.variance) * rng.standard_normal((100_000, 2))
    rays = np.concatenate([tangents, np.ones((100_000, 1))], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    ranges = 1.5 + stddev_m * rng.standard_normal((100_000, 1))
    offsets = ranges * rays - placed.position_m
    sampled = offsets.T @ offsets / len(offsets)
    # To second order in the angle, which is up to half a zone.
    scale = np.trace(sampled)
    assert np.abs(placed.covariance[:3, :3] - sampled).max() < 0.06 * scale
    direction = placed.position_m / 1.5
    along = direction @ placed.covariance[:3, :3] @ direction
    assert along == pytest.approx(direction @ sampled @ direction, rel=0.25)
    assert along >= stddev_m**2
    assert placed.covariance == pytest.approx(placed.covariance.T)
    assert np.linalg.eigvalsh(placed.covariance).min() > 0
    # Roll about the line of sight is not seen at all, tilt hardly.
    assert direction @ placed.covariance[3:, 3:] @ direction == pytest.approx(np.pi**2 / 3)


def shared_bearing(zone: int, light: Floats, variance: Floats, grid: ZoneGrid) -> Bearing:
    """Return what the core makes of the light in all zones."""
    table = ffi.new('struct rl_bearing_table *')
    lib.rl_bearing_start(table)
    arrays = (ffi.from_buffer('double[]', values) for values in (light, variance))
    seen = lib.rl_bearing_of(table, grid.rows, grid.columns, zone, *arrays, 0.0)
    mean, spread = np.array(list(seen.mean)), np.array(list(seen.variance))
    return Bearing(grid.tangents[zone] + grid.pitch * mean, grid.pitch**2 * spread)


def shares(grid: ZoneGrid, tangent: Floats, blur: float) -> Floats:
    position_m = np.append(tangent, 1.0)[None]
    light: Floats = zone_shares(position_m, SPOT, grid, blur)[0]
    return light


@both_grids
@pytest.mark.parametrize('blur', [0.05, 0.25])
def test_a_marker_on_a_border_is_found_there_whatever_the_blur(grid: ZoneGrid, blur: float) -> None:
    zone = grid.columns + 1
    corner = grid.tangents[zone] + grid.pitch / 2
    light = 100 * shares(grid, corner, blur)
    bearing = shared_bearing(zone, light, np.ones(grid.zones), grid)
    assert bearing.tangent == pytest.approx(corner, abs=0.01 * grid.pitch)
    assert np.all(bearing.variance < (0.05 * grid.pitch) ** 2)


@given(
    light=st.lists(st.floats(-100, 100), min_size=16, max_size=16).map(np.array),
    zone=st.integers(0, 15),
    variance=st.floats(1e-6, 1e4),
)
def test_no_bearing_is_certain(light: Floats, zone: int, variance: float) -> None:
    """Whatever zones have seen, also of other markers: a covariance must have an inverse."""
    variances = np.full(16, variance)
    variances[zone] = 0.0
    bearing = shared_bearing(zone, light, variances, GRID)
    assert np.all(np.isfinite(bearing.tangent))
    assert np.all(bearing.variance > (1e-3 * GRID.pitch) ** 2)


@given(
    across=st.floats(-0.5, 0.5),
    down=st.floats(-0.5, 0.5),
    blur=st.floats(0.05, 0.3),
    zone=st.sampled_from([5, 6, 9, 10]),
)
def test_truth_is_in_three_deviations(across: float, down: float, blur: float, zone: int) -> None:
    tangent = GRID.tangents[zone] + GRID.pitch * np.array([across, down])
    light = 200 * shares(GRID, tangent, blur)
    strongest = int(light.argmax())
    bearing = shared_bearing(strongest, light, np.ones(GRID.zones), GRID)
    assert np.all(np.abs(bearing.tangent - tangent) < 3 * np.sqrt(bearing.variance) + 1e-3)


@given(share=st.floats(-0.1, 0.9), stddev=st.floats(1, 20))
def test_a_bearing_is_the_mean_of_all_that_agree_with_shares(share: float, stddev: float) -> None:
    """An independent integral over bearings and blurs, the less likely the larger."""
    light, variance = np.zeros(GRID.zones), np.full(GRID.zones, stddev**2)
    light[[5, 6]] = 100.0, 100 * share
    places = np.linspace(-0.7, 0.7, 301)
    across = GRID.tangents[5][0] + GRID.pitch * places
    positions_m = np.stack([across, np.full(301, GRID.tangents[5][1]), np.ones(301)], axis=-1)
    nats = []
    for blur in (0.03, 0.05, 0.08, 0.12, 0.18, 0.25, 0.35):
        seen = zone_shares(positions_m, POINT, GRID, blur)[:, 4:7]
        common, energy = seen @ light[4:7], (seen**2).sum(axis=1)
        # A zone deviates from the model by 2 % of the brightest.
        evidence = np.maximum(common, 0) ** 2 / energy / 2 / (stddev**2 + 2.0**2)
        nats.append(evidence - np.log(blur) / 2)
    chances = np.exp(nats - np.max(nats)).sum(axis=0)
    mean = np.average(places, weights=chances)
    spread = np.sqrt(np.average((places - mean) ** 2, weights=chances))
    bearing = shared_bearing(5, light, variance, GRID)
    assert (bearing.tangent - GRID.tangents[5])[0] / GRID.pitch == pytest.approx(mean, abs=0.02)
    assert np.sqrt(bearing.variance[0]) / GRID.pitch == pytest.approx(spread, rel=0.05, abs=0.005)


def test_a_single_zone_without_noise_gives_its_middle() -> None:
    light = np.zeros(GRID.zones)
    light[5] = 100.0
    bearing = shared_bearing(5, light, np.full(GRID.zones, 0.01), GRID)
    assert bearing.tangent == pytest.approx(GRID.tangents[5], abs=1e-6)
    wide = shared_bearing(5, light, np.full(GRID.zones, 1e6), GRID)
    # All that is known then is the zone, and a bit beyond, should a neighbour see more of it.
    assert np.all(bearing.variance < zone_bearing(5, GRID).variance)
    assert np.all(wide.variance > zone_bearing(5, GRID).variance)


Samples = tuple[Floats, Floats, Floats]
"""Light, signal and distance of one zone, each of shape (frames,)."""


def ranged(
    light: Floats, signal: Floats, distance: Floats, valid: bool = True
) -> tuple[float, float]:
    """Return what the core makes of one zone: depth and standard deviation [m], or NaN."""
    rows, time_s = len(light), 0.021 * np.arange(len(light) + 1)
    held: dict[str, Any] = {
        'sensor': core_sensor(VL53L8CX, ZoneGrid()),
        'rows': rows,
        'begin_s': array('double', time_s[:-1]),
        'end_s': array('double', time_s[1:]),
        'light': array('double', light),
        'valid': array('uint8_t', np.full(rows, valid)),
        'signal': array('float', signal),
        'distance': array('float', distance),
        'orthogonal': array('double', np.zeros(rows)),
    }
    seen, found = ffi.new('struct rl_seen *', held), ffi.new('struct rl_ranged *')
    if not lib.rl_ranging(seen, ffi.new('float[]', rows), ffi.new('uint8_t[]', rows), found):
        return np.nan, np.nan
    return found.depth_m, float(np.sqrt(found.variance + found.common))


def ranges(make: Callable[[np.random.Generator], Samples]) -> tuple[Floats, Floats]:
    """Return by how much a marker at 1.5 m is off in 40 trials, and the deviations [m]."""
    found = [ranged(*make(np.random.default_rng(seed))) for seed in range(40)]
    depth_m, stddev_m = np.array(found).T
    return depth_m - 1.5, stddev_m


@pytest.mark.parametrize('wall', [0.0, 4.0, 60.0])
@pytest.mark.parametrize('wall_m', [1.45, 1.505, 1.8, 1.95, 2.3])
def test_what_stands_behind_does_not_shift_the_range(wall_m: float, wall: float) -> None:
    def blinking(rng: np.random.Generator) -> Samples:
        light = rng.integers(0, 2, 200).astype(float)
        own = 100.0 * light
        if abs(wall_m - 1.5) < 0.6:
            signal = own + wall
            distance = (own * 1.5 + wall * wall_m) / np.maximum(signal, 1e-9)
        else:
            signal = np.maximum(own, wall)
            distance = np.where(own > wall, 1.5, wall_m)
        distance = distance + 0.49 / np.maximum(signal, 1.0) * rng.standard_normal(200)
        distance[signal == 0] = np.nan
        return light, signal, distance

    off_m, stddev_m = ranges(blinking)
    assert stddev_m.max() < 0.006
    assert abs(np.mean(off_m / stddev_m)) < 0.6
    assert 0.6 < rms(off_m / stddev_m) < 1.5


@pytest.mark.parametrize(
    ('period_s', 'noise_m', 'bends'), [(0.5, 0.004, False), (1.5, 0.004, True), (2.6, 0.008, True)]
)
def test_the_range_of_a_marker_that_sways_is_where_it_was(
    period_s: float, noise_m: float, bends: bool
) -> None:
    """At the stamp, within its deviation; a slow sway is followed, of a fast one the mean taken."""
    scores, errors, of_means = [], [], []
    for seed in range(80):
        rng = np.random.default_rng(seed)
        light, time_s = rng.integers(0, 2, 62).astype(float), 0.021 * (np.arange(62) + 0.5)
        turn = rng.uniform(0, 2 * np.pi)
        own_m = 1.5 + 0.02 * np.sin(2 * np.pi * time_s / period_s + turn)
        distance = np.where(light > 0, own_m + noise_m * rng.standard_normal(62), np.nan)
        depth_m, stddev_m = ranged(light, 100 * light, distance)
        middle_s = time_s[light > 0].mean()
        there_m = 1.5 + 0.02 * np.sin(2 * np.pi * middle_s / period_s + turn)
        errors.append(depth_m - there_m)
        scores.append(errors[-1] / stddev_m)
        of_means.append(np.nanmean(distance) - there_m)
    assert 0.6 < rms(scores) < 2.0
    better = rms(errors) / rms(of_means)
    assert better < 0.6 if bends else better == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize('seen_m', [1.9, 2.9])
def test_samples_of_something_else_do_not_shift_the_range(seen_m: float) -> None:
    """The marker leaves the zone, and the wall is seen, or a third of the samples show a hand."""

    def disturbed(rng: np.random.Generator) -> Samples:
        light = rng.integers(0, 2, 120).astype(float)
        other = np.arange(120) >= 50 if seen_m < 2 else rng.random(120) < 0.3
        signal = np.where(other, 4.0 if seen_m < 2 else 150.0, 100 * light + 4)
        bright_m = (100 * 1.5 + 4 * seen_m) / 104 if seen_m < 2 else 1.5
        distance = np.where(other | (light == 0), seen_m, bright_m)
        return light, signal, distance + 0.49 / signal * rng.standard_normal(120)

    off_m, stddev_m = ranges(disturbed)
    assert 0.6 < rms(off_m / stddev_m) < 1.7


def test_a_far_wall_that_shows_while_the_marker_is_dark_does_not_shift_the_range() -> None:
    """A dark marker sends a little light back, which mostly outshines the wall."""

    def before_a_wall(rng: np.random.Generator) -> Samples:
        light = rng.integers(0, 2, 62).astype(float)
        signal = np.maximum(50 * light + 4 + 2 * rng.standard_normal(62), 1)
        is_wall = (light == 0) & (rng.random(62) < 0.3)
        distance = np.where(is_wall, 3.7, 1.5) + 0.49 / signal * rng.standard_normal(62)
        return light, signal, distance

    off_m, stddev_m = ranges(before_a_wall)
    assert rms(off_m) < 0.005
    assert 0.6 < rms(off_m / stddev_m) < 1.5


def test_a_range_needs_distances_of_valid_samples() -> None:
    light = np.tile([0.0, 1.0], 10)
    assert np.isnan(ranged(light, 50 * light, np.full(20, np.nan))).all()
    assert np.isnan(ranged(light, 50 * light, light + 1, valid=False)).all()


def placed_in(zones: dict[int, float], crosses: bool = False, seed: int = 9) -> Detection:
    """Return what is read of a lone packet that zones see at such distances, before a wall.

    One that crosses goes from the first of two zones to the second.
    """
    middle_s = np.arange(PERIOD_S / 2, 1.6 * PACKET_S, PERIOD_S)
    light = 60 * light_at(middle_s, sent(2073, 0.5))
    gone = np.clip((middle_s - 0.5) / PACKET_S, 0, 1)
    mean = np.full((len(light), GRID.zones), 10.0)
    distance = np.full(mean.shape, 1.5)
    for index, (zone, depth_m) in enumerate(zones.items()):
        seen = light * ((1 - gone, gone)[index] if crosses else 1)
        distance[:, zone] = (10 * 1.5 + seen * depth_m) / (10 + seen)
        mean[:, zone] += seen
    rng = np.random.default_rng(seed)
    distance += 0.49 / mean * rng.standard_normal(mean.shape)
    recording = noisy(middle_s, mean, rng, distance)
    (detection,) = create_detector('joint', GRID).update_all(recording)
    return detection


def test_a_range_is_the_mean_of_those_of_all_zones() -> None:
    one, four = (placed_in(dict.fromkeys(zones, 1.5)) for zones in ((5,), (5, 6, 9, 10)))
    assert set(four.zones) == {5, 6, 9, 10}
    assert four.place.range_stddev_m < 0.65 * one.place.range_stddev_m


def test_zones_that_differ_say_how_sure_their_mean_is() -> None:
    alike, apart = (placed_in({5: 1.5, 6: depth_m}) for depth_m in (1.5, 1.56))
    assert alike.place.range_stddev_m < 0.005
    assert apart.place.range_stddev_m == pytest.approx(0.03, abs=0.01)


def test_a_reflection_in_a_far_zone_is_no_part_of_a_place() -> None:
    depths_m = {5: 1.5, 15: 2.3}
    far = placed_in(depths_m)
    (zone,) = far.zones  # either one is as bright
    alone = placed_in({zone: depths_m[zone]})
    assert far.place.range_m == pytest.approx(alone.place.range_m, abs=0.01)


def test_a_stronger_marker_beside_does_not_shift_the_range() -> None:
    """It is read in zone 5 only, but some of its light falls into zone 6, where this one is."""
    middle_s = np.arange(PERIOD_S / 2, 4 * PACKET_S, PERIOD_S)
    strong = light_at(middle_s, sent(2073, 0.3, repeats=True))
    weak = light_at(middle_s, sent(628, 0.5, repeats=True, bit_s=0.0421))
    mean = np.full((len(middle_s), GRID.zones), 5.0)
    mean[:, 5] += 1000 * strong
    mean[:, 6] += 50 * strong + 100 * weak
    depth_m = np.full(mean.shape, 1.8)
    depth_m[:, 5] = (5 * 1.8 + 1000 * strong * 1.3) / mean[:, 5]
    depth_m[:, 6] = (5 * 1.8 + 50 * strong * 1.3 + 100 * weak * 1.7) / mean[:, 6]
    scores = []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        measured_m = depth_m + 0.49 / mean * rng.standard_normal(mean.shape)
        recording = noisy(middle_s, mean, rng, measured_m)
        for one in create_detector('joint', GRID).update_all(recording):
            assert one.zones == ((5,) if one.id == 2073 else (6,))
            if one.id == 628:
                assert one.place.range_stddev_m < 0.01
                off_m = one.place.range_m - 1.7 / GRID.z_per_range[6]
                scores.append(off_m / one.place.range_stddev_m)
    assert len(scores) >= 15
    assert 0.6 < rms(scores) < 1.5


def test_the_bearing_of_a_marker_that_crosses_is_that_unsure() -> None:
    scores = []
    for seed in range(20):
        placed = placed_in({5: 1.5, 6: 1.5}, crosses=True, seed=seed).place
        border = (GRID.tangents[5] + GRID.tangents[6])[0] / 2
        off_m = placed.position_m[0] - placed.position_m[2] * border
        scores.append(off_m / np.sqrt(placed.covariance[0, 0]))
    assert 0.5 < rms(scores) < 1.1


@pytest.mark.parametrize('number', [7, 3287])
def test_a_hand_that_passes_beside_a_marker_moves_it_nowhere(number: int) -> None:
    """Two frames show a target in zones that have none; any gain fits so few samples."""
    middle_s = np.arange(PERIOD_S / 2, 1.9 * PACKET_S, PERIOD_S)
    mean = np.zeros((len(middle_s), GRID.zones))
    mean[:, 5] = 30 + 2000 * light_at(middle_s, sent(number, 0.5))
    plain = noisy(middle_s, mean, np.random.default_rng(1), 0.5)
    last = round((0.5 + PACKET_S) / PERIOD_S)
    for frame in range(last - 20, last):
        signal = plain.signal.copy()
        status = np.where(mean > 0, Status.VALID, Status.NO_TARGET).astype(plain.status.dtype)
        signal[frame : frame + 2, [1, 4, 6, 9]] = [[300.0], [150.0]]
        status[frame : frame + 2, [1, 4, 6, 9]] = Status.VALID
        seen = replace(plain, signal=signal, status=status)
        (detection,) = create_detector('joint', GRID).update_all(seen)
        assert detection.zones == (5,)
