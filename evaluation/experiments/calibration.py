# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibration: recordings of emulated sensors that it has not seen, truth beside estimate."""

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.report.chart_style import label, legend_under, look, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.code import IDS, PACKET_BITS
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene import Scene, Simulation, description
from retrolidar_ros.scene.laboratory import see_surface
from retrolidar_ros.scene.optics import received_signal, zone_shares
from retrolidar_ros.scene.transmission import Transmission, exposure_edges
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid
from retrolidar_ros.tasks.calibration.calibrate import Calibration, calibrate
from retrolidar_ros.tasks.calibration.crystal import DARK_S
from retrolidar_ros.tasks.calibration.estimate import Estimate
from retrolidar_ros.tasks.calibration.files import parameters

TITLE = 'Calibration from a recording'
MESSAGE = 'What a calibration says of its own errors holds'
_TRIALS, _QUICK_TRIALS = 16, 2
SCALES = (0.25, 1.0, 4.0, 8.0)
# Frame period [s], and rows of zones.
_SENSORS = ((1 / 60, 4), (0.021, 4), (1 / 30, 4), (1 / 15, 8))
_RISE_MS = 1.0  # how well the time in which a crystal brightens is to be found, where that can be
_FEW = 0.5  # of the packets, below which a recording counts as not read
_SECONDS = 30.0
_SIGNALS = np.array([5.0, 30.0, 100.0])  # where a law of noise is held against the truth
_READ_PACKETS = 7  # of a recording, for how much is read before and after
_STEPS = np.array([1e-7, 2e-5, 5e-5, 5e-5])  # of bit, start, darkening and brightening [s]


def _room(rng: np.random.Generator, period_s: float, rows: int, scale: float) -> Scene:
    """Return a marker 0.6 to 1 m away on a wall, with paper of other brightness beside it."""
    grid = ZoneGrid(rows, rows)
    bit_s = float(rng.uniform(max(2 * period_s, 0.02), min(8 * period_s, 0.3)))
    inner = [zone for zone in range(grid.zones) if 0 < zone % rows < rows - 1]
    ray = np.append(grid.tangents[rng.choice(inner)] + rng.uniform(-0.3, 0.3, 2) * grid.pitch, 1.0)
    x, y, z = (float(rng.uniform(0.6, 1.0)) * ray / np.linalg.norm(ray)).tolist()
    marker = description.Marker(
        id=int(rng.integers(1, IDS - 1)),
        position_m=(x, y, z),
        name='marker',
        bit_period_s=bit_s,
        clock_error=float(rng.uniform(-0.01, 0.01)),
        start_s=float(rng.uniform(0, 1)),
        signal_at_1_m=float(rng.uniform(200, 500)),
        contrast=float(rng.uniform(0.6, 1.0)),
        response=Response(0.0005, float(rng.uniform(0.001, min(0.02, bit_s / 2)))),
    )
    sensor = description.Sensor(
        grid=grid,
        period_s=period_s,
        period_error=float(rng.uniform(-0.005, 0.005)),
        jitter_s=0.001,
        blur=float(rng.uniform(0.03, 0.25)),
        noise=description.Noise(4.6 * scale, 0.22 * scale),
        ranging=description.Ranging(0.49, 0.0016, float(rng.uniform(-0.03, 0.03))),
    )
    others = tuple(zone for zone in range(grid.zones) if zone % rows)
    paper = zip(range(0, grid.zones, rows), np.geomspace(20, 200, rows).tolist(), strict=True)
    return Scene(
        seed=int(rng.integers(2**31)),
        ambient=4.0,
        sensor=sensor,
        markers=(marker,),
        surfaces=(
            description.Surface(z + 0.02, float(rng.uniform(5, 30)), others),
            *(description.Surface(z + 0.5, signal, (zone,)) for zone, signal in paper),
        ),
    )


def _sensor(**changes: Any) -> Callable[[Scene], Scene]:
    return lambda scene: replace(scene, sensor=replace(scene.sensor, **changes))


def _dark_is_nothing(scene: Scene) -> Scene:
    """Return a scene in which the sensor sees no target where the marker is dark."""
    wall, *paper = scene.surfaces
    marker = replace(scene.markers[0], contrast=1.0)
    scene = replace(scene, markers=(marker,), surfaces=(replace(wall, signal=3.0), *paper))
    return _sensor(target_threshold=15.0)(scene)


KINDS: dict[str, Callable[[Scene], Scene]] = {
    'dark bits are no target': _dark_is_nothing,
    '20 % of samples invalid': _sensor(abnormal=0.2),
    '10 % of frames lost': _sensor(lost=0.1),
    'a cover glass': _sensor(crosstalk=60.0),
    "another sensor's light": _sensor(second_sensor=description.SecondSensor(30.0, 0.033, 0.011)),
    'walls a metre behind': lambda scene: replace(
        scene, surfaces=tuple(replace(one, distance_m=2.5) for one in scene.surfaces)
    ),
}  # what else recordings are of, that are read before and after calibration


def _rise_bound(scene: Scene, recording: Recording) -> float:
    """Return the Cramér–Rao bound of the time in which the crystal brightens [s].

    Bit period, start, darkening, levels and gains are unknown, too, but for what `calibrate`
    assumes of darkening.
    """
    marker, sensor = scene.markers[0], scene.sensor
    assert marker.response is not None
    assert sensor.noise is not None
    period_s = sensor.period_s * (1 + sensor.period_error)

    def light(values: Floats) -> Floats:
        bit, start, dark, bright = values.tolist()
        sent = replace(marker, bit_period_s=bit, start_s=start, response=Response(dark, bright))
        return Transmission.of(replace(sent, clock_error=0.0)).mean(edges_s)

    edges_s = exposure_edges(recording.stamp_ns * 1e-9, period_s)
    bit_s = marker.bit_period_s * (1 + marker.clock_error)
    crystal = marker.response
    truth = np.array([bit_s, marker.start_s, crystal.dark_s, crystal.bright_s])
    around = [light(truth + step) - light(truth - step) for step in np.diag(_STEPS)]
    slopes = np.column_stack(around) / (2 * _STEPS)
    place = np.array([marker.position_m])
    share = zone_shares(place, marker.size_m, sensor.grid, sensor.blur)[0]
    most = share * received_signal(
        np.linalg.norm(place, axis=1), marker.size_m**2, 0.0, marker.signal_at_1_m
    )
    walls = sum(see_surface(sensor, wall, edges_s[:, 0])[0][0] for wall in scene.surfaces)
    seen, information = light(truth), np.diag([0.0, 0.0, DARK_S.stddev**-2, 0.0])
    dark = most * (1 - marker.contrast) + walls
    for gain, wall in zip(marker.contrast * most, dark, strict=True):
        root = (sensor.noise.floor + sensor.noise.slope * (wall + gain * seen)) ** -0.5
        linear = np.linalg.qr(root[:, None] * np.column_stack([np.ones_like(seen), seen]))[0]
        own = gain * root[:, None] * slopes
        own -= linear @ (linear.T @ own)
        information += own.T @ own
    return float(np.sqrt(np.linalg.inv(information)[3, 3]))


def _packets_read(recording: Recording, scene: Scene, values: dict[str, Any]) -> float:
    """Return the share of the time of some packets in which a repeating marker was read."""
    marker = scene.markers[0]
    packet_ns = PACKET_BITS * marker.bit_period_s * (1 + marker.clock_error) * 1e9
    since_ns = recording.stamp_ns - recording.stamp_ns[0]
    frames = int(np.searchsorted(since_ns, marker.start_s * 1e9 + _READ_PACKETS * packet_ns))
    begin_ns, end_ns = recording.stamp_ns[[0, min(frames, len(recording)) - 1]].tolist()
    covered = np.zeros(int((end_ns - begin_ns) * 1e-7) + 1, dtype=bool)
    for one in Decoding({**defaults(), **values}).detect(itertools.islice(recording, frames)):
        if one.id == marker.id:
            first = int((one.end_ns - one.packets * packet_ns - begin_ns) * 1e-7)
            covered[max(first, 0) : int((one.end_ns - begin_ns) * 1e-7)] = True
    # The last packet may not have ended, and the first has not before it starts.
    inside = slice(int((marker.start_s + 0.1) * 100), -int(packet_ns * 1e-7) or None)
    return float(covered[inside].mean())


def _read(recording: Recording, scene: Scene, found: Calibration) -> dict[str, Any]:
    values = {name: value for name, (value, _) in parameters(found).items()}
    return {
        'read before': _packets_read(recording, scene, {}),
        'read after': _packets_read(recording, scene, values),
    }


def _trial(scene: Scene) -> dict[str, Any]:
    """Return errors of what is found, with what they claim, and what is read before and after."""
    recording = Simulation(scene).run(_SECONDS)
    marker, sensor = scene.markers[0], scene.sensor
    assert sensor.noise is not None
    assert sensor.ranging is not None
    assert marker.response is not None
    found = calibrate(recording, distance_m=float(np.linalg.norm(marker.position_m)))
    truth = sensor.noise.floor + sensor.noise.slope * _SIGNALS
    result = _read(recording, scene, found) | {
        'noise': float(np.abs(found.law.variance(_SIGNALS) / truth - 1).max()),
        'identified': [one.sent.id for one in found.markers] == [marker.id],
        'rise bound [ms]': 1e3 * _rise_bound(scene, recording),
        'errors': {},
    }

    def add(name: str, estimate: Estimate | None, true: float) -> None:
        if estimate is not None:
            result['errors'][name] = [estimate.value - true, estimate.stddev]

    if found.noise:
        add('floor', found.noise.floor, sensor.noise.floor)
        add('slope', found.noise.slope, sensor.noise.slope)
    period_s = sensor.period_s * (1 + sensor.period_error)
    add('frame period', found.timing.period_s.times(1 / period_s), 1.0)
    for one in found.markers[:1] if result['identified'] else []:
        bit_s = marker.bit_period_s * (1 + marker.clock_error)
        add('bit period', one.sent.bit_period_s.times(1 / bit_s), 1.0)
        add('rise [ms]', one.sent.bright_s.times(1e3), 1e3 * marker.response.bright_s)
        add('contrast', one.contrast, marker.contrast)
    if found.link:
        add('offset [mm]', found.link.offset_m.times(1e3), 1e3 * sensor.ranging.offset)
    return result


def _sweep_trial(rng: np.random.Generator, period_s: float) -> list[float]:
    """Return error and deviation of the blur found from a sweep there and back."""
    scene = _room(rng, period_s, 4, 1.0)
    depth_m = float(rng.uniform(0.5, 0.8))
    marker = replace(scene.markers[0], position_m=(0.0, 0.02, depth_m), bit_period_s=2 * period_s)
    marker = replace(marker, response=Response(0.0005, 0.0035))
    ends = ((0.0, -0.5), (_SECONDS / 2, 0.5), (_SECONDS, -0.5))
    path = tuple(
        description.Waypoint(time_s, (share * depth_m, 0.0, 0.0)) for time_s, share in ends
    )
    sensor = replace(scene.sensor, path=path)
    walls = (description.Surface(depth_m + 0.02, 10.0),)
    scene = replace(scene, sensor=sensor, markers=(marker,), surfaces=walls)
    found = calibrate(Simulation(scene).run(_SECONDS)).sweep
    return [] if found is None else [found.blur.value - sensor.blur, found.blur.stddev]


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return all trials, by the scale of the noise and the sensor."""
    count = _QUICK_TRIALS if quick else _TRIALS
    sensors = itertools.product(SCALES, (_SENSORS * count)[:count])
    trials = [{'scale': scale, **_trial(_room(rng, *sensor, scale))} for scale, sensor in sensors]
    sweeps = [_sweep_trial(rng, _SENSORS[index % 3][0]) for index in range(count)]
    kinds = []
    for kind, change in list(KINDS.items())[:: 3 if quick else 1]:
        for period_s, rows in _SENSORS[: 1 if quick else None]:
            scene = change(_room(rng, period_s, rows, scale=4.0))
            recording = Simulation(scene).run(_SECONDS)
            kinds.append({'kind': kind} | _read(recording, scene, calibrate(recording)))
    return {'trials': trials, 'sweeps': sweeps, 'kinds': kinds}


def _errors(figures: dict[str, Any]) -> dict[str, Floats]:
    """Return errors and deviations of every quantity, shape (trials, 2)."""
    names = dict.fromkeys(name for one in figures['trials'] for name in one['errors'])
    errors = {
        name: np.array([one['errors'][name] for one in figures['trials'] if name in one['errors']])
        for name in names
    }
    errors['blur'] = np.array([one for one in figures['sweeps'] if one])
    return errors


def table(figures: dict[str, Any]) -> Table:
    """Return the largest error of everything, and how often the intervals hold the truth."""
    trials = figures['trials']
    within = f'within {_RISE_MS:g} ms / at best / or twice the bound'
    rows = [['', 'estimates', 'largest error', 'held by 95 %', within, 'bound, median and largest']]

    def add(what: str, errors: Floats, *bound: str) -> NDArray[np.bool_]:
        held: NDArray[np.bool_] = np.abs(errors[:, 0]) < 1.96 * errors[:, 1]
        worst = f'{np.abs(errors[:, 0]).max():.4g}'
        rows.append([what, str(len(errors)), worst, f'{held.mean():.0%}', *(bound or ('', ''))])
        return held

    inside = np.concatenate([add(name, errors) for name, errors in _errors(figures).items()])
    for scale in dict.fromkeys(one['scale'] for one in trials):
        alike = [one for one in trials if one['scale'] == scale and 'rise [ms]' in one['errors']]
        errors = np.array([one['errors']['rise [ms]'] for one in alike])
        bound_ms = np.array([one['rise bound [ms]'] for one in alike])
        off_ms = np.abs(errors[:, 0])
        shares = (
            off_ms < _RISE_MS,
            [math.erf(_RISE_MS / one / math.sqrt(2)) for one in bound_ms],
            off_ms < np.maximum(_RISE_MS, 2 * bound_ms),
        )
        words = ' / '.join(f'{np.mean(share):.0%}' for share in shares)
        bounds = f'{np.median(bound_ms):.2g} ms, {bound_ms.max():.2g} ms'
        add(f'rise [ms], noise {scale:g} times the usual', errors, words, bounds)
    law = f'{100 * max(one["noise"] for one in trials):.1f} %'
    rows.append(['noise law', str(len(trials)), law, *[''] * 3])
    rows.append(['all', str(len(inside)), '', f'{100 * np.mean(inside):.1f} %', '', ''])
    kinds = {kind: [one for one in figures['kinds'] if one['kind'] == kind] for kind in KINDS}
    for what, recordings in {'as above': trials, **kinds}.items():
        after = [one['read after'] for one in recordings if one['read before'] < _FEW]
        missed = f'{100 * (1 - np.mean(after or [1.0])):.1f} %'
        rows.append([f'packets not read: {what}', str(len(after)), missed, *[''] * 3])
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw errors against what they claim to be, quantity by quantity."""
    errors = _errors(figures)
    figure, (axis,) = new_chart(1, 1, 4.6, MESSAGE)
    for index, one in enumerate(errors.values()):
        scores = one[:, 0] / np.maximum(one[:, 1], 1e-12)
        across = index + 0.6 * (np.arange(len(scores)) / max(len(scores), 1) - 0.5)
        axis.plot(across, np.clip(scores, -5, 5), '.', color=look('joint')['color'], markersize=4)
    axis.axhspan(-1.96, 1.96, color='0.9', zorder=0, label='95 of 100 are to be here')
    label(axis, '', 'error / its standard deviation')
    axis.set_xticks(range(len(errors)), [name.split(' [')[0] for name in errors])
    legend_under(axis)
    return figure
