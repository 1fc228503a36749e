# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibration: what it changes to know a parameter, and how well each is found.

Parameters are told to the detector over the range that sensors and markers have; recordings are of
emulated sensors that the calibration has not seen.
"""

import itertools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.calibration_effects import PARAMETERS, effect
from evaluation.report.chart_style import OTHERS, label, look, new_chart
from evaluation.report.claims import Table, as_text
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.code import IDS, PACKET_BITS
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene import Scene, Simulation, description
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid
from retrolidar_ros.tasks.calibration.calibrate import Calibration, calibrate
from retrolidar_ros.tasks.calibration.estimate import Estimate
from retrolidar_ros.tasks.calibration.report import parameters

TITLE = 'Calibration from a recording'
MESSAGE = 'Bit period, noise and range offset change what is read; optics hardly'
_TRIALS, _QUICK_TRIALS = 16, 2
SCALES = (0.25, 1.0, 4.0, 8.0)
# Frame period [s], and rows of zones.
_SENSORS = ((1 / 60, 4), (0.021, 4), (1 / 30, 4), (1 / 15, 8))
_MARKERS, _QUICK_MARKERS = 150, 3  # of each value of a parameter
_SIGNS = {'range': ('o', OTHERS[0]), 'position': ('^', OTHERS[2])}
_FEW = 0.5  # of the packets, below which a recording counts as not read
_SECONDS = 30.0
_SIGNALS = np.array([5.0, 30.0, 100.0])  # where a law of noise is held against the truth
_READ_PACKETS = 7  # of a recording, for how much is read before and after


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
    found = calibrate(recording, distance_m=float(np.linalg.norm(marker.position_m)))
    truth = sensor.noise.floor + sensor.noise.slope * _SIGNALS
    result = _read(recording, scene, found) | {
        'noise': float(np.abs(found.law.variance(_SIGNALS) / truth - 1).max()),
        'identified': [one.id for one in found.markers] == [marker.id],
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
        add('bit period', one.bit_period_s.times(1 / bit_s), 1.0)
    if found.link:
        add('offset [mm]', found.link.offset_m.times(1e3), 1e3 * sensor.ranging.offset)
    return result


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return all trials, by the scale of the noise and the sensor."""
    count = _QUICK_TRIALS if quick else _TRIALS
    sensors = itertools.product(SCALES, (_SENSORS * count)[:count])
    trials = [{'scale': scale, **_trial(_room(rng, *sensor, scale))} for scale, sensor in sensors]
    effects = {
        name: [effect(name, value, _QUICK_MARKERS if quick else _MARKERS, rng) for value in values]
        for name, (_, values, _) in PARAMETERS.items()
    }
    kinds = []
    for kind, change in list(KINDS.items())[:: 3 if quick else 1]:
        for period_s, rows in _SENSORS[: 1 if quick else None]:
            scene = change(_room(rng, period_s, rows, scale=4.0))
            recording = Simulation(scene).run(_SECONDS)
            kinds.append({'kind': kind} | _read(recording, scene, calibrate(recording)))
    return {'effects': effects, 'trials': trials, 'kinds': kinds}


def _errors(figures: dict[str, Any]) -> dict[str, Floats]:
    """Return errors and deviations of every quantity, shape (trials, 2)."""
    names = dict.fromkeys(name for one in figures['trials'] for name in one['errors'])
    return {
        name: np.array([one['errors'][name] for one in figures['trials'] if name in one['errors']])
        for name in names
    }


def table(figures: dict[str, Any]) -> Table:
    """Return what each parameter changes, how well it is found, and what is then read."""
    rows = [['told to the detector', 'read by default', 'read when told', 'range', 'position']]
    for name, (unit, _, _) in PARAMETERS.items():
        for one in figures['effects'][name]:
            shares = (f'{one["read " + how]:.0%}' for how in ('by default', 'when told'))
            changes = (as_text(one[key], 'deviations', 1) for key in ('range', 'position'))
            rows.append([f'{name}: {one["value"]:.3g} {unit}', *shares, *changes])
    rows.append(['found by calibrate', 'estimates', 'largest error', 'held by 95 %', ''])
    inside = []
    for name, errors in _errors(figures).items():
        held = np.abs(errors[:, 0]) < 1.96 * errors[:, 1]
        worst = f'{np.abs(errors[:, 0]).max():.4g}'
        rows.append([name, str(len(errors)), worst, f'{held.mean():.0%}', ''])
        inside.append(held)
    trials = figures['trials']
    law = f'{100 * max(one["noise"] for one in trials):.1f} %'
    rows.append(['noise law', str(len(trials)), law, '', ''])
    every = np.concatenate(inside)
    rows.append(['all', str(len(every)), '', f'{every.mean():.1%}', ''])
    kinds = {kind: [one for one in figures['kinds'] if one['kind'] == kind] for kind in KINDS}
    for what, recordings in {'as above': trials, **kinds}.items():
        after = [one['read after'] for one in recordings if one['read before'] < _FEW]
        missed = f'{100 * (1 - np.mean(after or [1.0])):.1f} %'
        rows.append([f'packets not read: {what}', str(len(after)), missed, '', ''])
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw what each parameter changes, in points of reads and in deviations."""
    figure, (reads, ranges) = new_chart(2, 2, 4.6, MESSAGE)
    for index, name in enumerate(PARAMETERS):
        effects = figures['effects'][name]
        along = index + 0.15 * (np.arange(len(effects)) - (len(effects) - 1) / 2)
        gain = [100 * (one['read when told'] - one['read by default']) for one in effects]
        reads.plot(along, gain, 'o', color=look('joint')['color'])
        for key, (sign, colour) in _SIGNS.items():
            changed = [np.nan if one[key] is None else one[key] for one in effects]
            ranges.plot(along, changed, sign, color=colour, label='' if index else key)
    for axis, title in ((reads, 'more read [points]'), (ranges, 'change [deviations]')):
        axis.axhspan(-1, 1, color='0.9', zorder=0)
        axis.set_yscale('symlog', linthresh=1)
        label(axis, '', title)
        axis.set_xticks(range(len(PARAMETERS)), [name.replace(' ', '\n') for name in PARAMETERS])
    ranges.legend(frameon=False)
    return figure
