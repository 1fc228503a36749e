# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of emulated sensors that nothing is known of, and what calibration makes of them."""

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.code import IDS, PACKET_BITS
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import (
    Marker,
    Noise,
    Ranging,
    SecondSensor,
    Sensor,
    Surface,
    Waypoint,
)
from retrolidar_ros.scene.laboratory import see_surface
from retrolidar_ros.scene.optics import received_signal, zone_shares
from retrolidar_ros.scene.transmission import Transmission
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid
from retrolidar_ros.tasks.calibration.calibrate import Calibration, calibrate
from retrolidar_ros.tasks.calibration.crystal import DARK_S
from retrolidar_ros.tasks.calibration.estimate import Estimate
from retrolidar_ros.tasks.calibration.files import parameters

SECONDS = 30.0
SIGNALS = np.array([5.0, 30.0, 100.0])
"""At which a law of noise is held against the truth [kcps/SPAD]."""
_READ_PACKETS = 7  # of a recording, for how much is read before and after
_STEPS = np.array([1e-7, 2e-5, 5e-5, 5e-5])  # of bit, start, darkening and brightening [s]


def room(rng: np.random.Generator, period_s: float, rows: int, scale: float) -> Scene:
    """Return a marker 0.6 to 1 m away on a wall, with paper of other brightness beside it."""
    grid = ZoneGrid(rows, rows)
    bit_s = float(rng.uniform(max(2 * period_s, 0.02), min(8 * period_s, 0.3)))
    inner = [zone for zone in range(grid.zones) if 0 < zone % rows < rows - 1]
    ray = np.append(grid.tangents[rng.choice(inner)] + rng.uniform(-0.3, 0.3, 2) * grid.pitch, 1.0)
    range_m = float(rng.uniform(0.6, 1.0))
    x, y, z = (range_m * ray / np.linalg.norm(ray)).tolist()
    marker = Marker(
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
    sensor = Sensor(
        grid=grid,
        period_s=period_s,
        period_error=float(rng.uniform(-0.005, 0.005)),
        jitter_s=0.001,
        blur=float(rng.uniform(0.03, 0.25)),
        noise=Noise(4.6 * scale, 0.22 * scale),
        ranging=Ranging(0.49, 0.0016, float(rng.uniform(-0.03, 0.03))),
    )
    left = [zone for zone in range(grid.zones) if zone % rows == 0]
    others = tuple(zone for zone in range(grid.zones) if zone % rows)
    paper = zip(left, np.geomspace(20, 200, len(left)).tolist(), strict=True)
    return Scene(
        seed=int(rng.integers(2**31)),
        ambient=4.0,
        sensor=sensor,
        markers=(marker,),
        surfaces=(
            Surface(z + 0.02, float(rng.uniform(5, 30)), others),
            *(Surface(z + 0.5, signal, (zone,)) for zone, signal in paper),
        ),
    )


def _sensor(**changes: Any) -> Callable[[Scene], Scene]:
    """Return what changes the sensor of a scene."""
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
    "another sensor's light": _sensor(second_sensor=SecondSensor(30.0, 0.033, 0.011)),
    'walls a metre behind': lambda scene: replace(
        scene, surfaces=tuple(replace(one, distance_m=2.5) for one in scene.surfaces)
    ),
}  # what else recordings are of, that are read before and after calibration


def rise_bound(scene: Scene, recording: Recording) -> float:
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
        return Transmission(replace(sent, clock_error=0.0)).mean(time_s, period_s)

    time_s = recording.stamp_ns * 1e-9
    bit_s = marker.bit_period_s * (1 + marker.clock_error)
    crystal = marker.response
    truth = np.array([bit_s, marker.start_s, crystal.dark_s, crystal.bright_s])
    seen = light(truth)
    slopes = np.stack(
        [
            (light(truth + step) - light(truth - step)) / (2 * step.max())
            for step in np.diag(_STEPS)
        ],
        axis=-1,
    )
    place = np.array([marker.position_m])
    share = zone_shares(place, marker.size_m, sensor.grid, sensor.blur)[0]
    range_m = np.linalg.norm(place, axis=1)
    most = share * received_signal(range_m, marker.size_m**2, 0.0, marker.signal_at_1_m)
    walls = sum(see_surface(sensor, wall, time_s)[0][0] for wall in scene.surfaces)
    information = np.diag([0.0, 0.0, DARK_S.stddev**-2, 0.0])
    for gain, wall in zip(
        marker.contrast * most, most * (1 - marker.contrast) + walls, strict=True
    ):
        root = (sensor.noise.floor + sensor.noise.slope * (wall + gain * seen)) ** -0.5
        linear = np.linalg.qr(root[:, None] * np.column_stack([np.ones_like(seen), seen]))[0]
        own = gain * root[:, None] * slopes
        own -= linear @ (linear.T @ own)
        information += own.T @ own
    return float(np.sqrt(np.linalg.inv(information)[3, 3]))


def packets_read(recording: Recording, scene: Scene, values: dict[str, Any]) -> float:
    """Return the share of the time of some packets in which a repeating marker was read."""
    marker = scene.markers[0]
    packet_ns = PACKET_BITS * marker.bit_period_s * (1 + marker.clock_error) * 1e9
    since_ns = recording.stamp_ns - recording.stamp_ns[0]
    frames = int(np.searchsorted(since_ns, marker.start_s * 1e9 + _READ_PACKETS * packet_ns))
    begin_ns, end_ns = recording.stamp_ns[[0, min(frames, len(recording)) - 1]].tolist()
    covered = np.zeros(int((end_ns - begin_ns) * 1e-7) + 1, dtype=bool)
    for one in Decoding({**defaults(), **values}).detect(islice(recording, frames)):
        if one.id == marker.id:
            first = int((one.end_ns - one.packets * packet_ns - begin_ns) * 1e-7)
            covered[max(first, 0) : int((one.end_ns - begin_ns) * 1e-7)] = True
    # The last packet may not have ended, and the first has not before it starts.
    inside = slice(int((marker.start_s + 0.1) * 100), -int(packet_ns * 1e-7) or None)
    return float(covered[inside].mean())


def _read(recording: Recording, scene: Scene, found: Calibration) -> dict[str, Any]:
    """Return what is read before and after a calibration."""
    values = {name: value for name, (value, _) in parameters(found).items()}
    return {
        'read before': packets_read(recording, scene, {}),
        'read after': packets_read(recording, scene, values),
    }


def trial(scene: Scene) -> dict[str, Any]:
    """Return errors of what is found, with what they claim, and what is read before and after."""
    recording = Simulation(scene).run(SECONDS)
    marker, sensor = scene.markers[0], scene.sensor
    assert sensor.noise is not None
    assert sensor.ranging is not None
    assert marker.response is not None
    found = calibrate(recording, distance_m=float(np.linalg.norm(marker.position_m)))
    truth = sensor.noise.floor + sensor.noise.slope * SIGNALS
    result = _read(recording, scene, found) | {
        'noise': float(np.abs(found.law.variance(SIGNALS) / truth - 1).max()),
        'identified': [one.sent.id for one in found.markers] == [marker.id],
        'rise bound [ms]': 1e3 * rise_bound(scene, recording),
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


def kind_trial(kind: str, scene: Scene) -> dict[str, Any]:
    """Return what is read before and after calibration of a recording of a kind."""
    scene = KINDS[kind](scene)
    recording = Simulation(scene).run(SECONDS)
    return {'kind': kind} | _read(recording, scene, calibrate(recording))


def sweep_trial(rng: np.random.Generator, period_s: float) -> list[float]:
    """Return error and deviation of the blur found from a sweep there and back."""
    scene = room(rng, period_s, 4, 1.0)
    depth_m = float(rng.uniform(0.5, 0.8))
    bit_s = 2 * period_s
    marker = replace(
        scene.markers[0],
        position_m=(0.0, 0.02, depth_m),
        bit_period_s=bit_s,
        response=Response(0.0005, 0.0035),
    )
    ends = ((0.0, -0.5), (SECONDS / 2, 0.5), (SECONDS, -0.5))
    path = tuple(Waypoint(time_s, (share * depth_m, 0.0, 0.0)) for time_s, share in ends)
    sensor = replace(scene.sensor, path=path)
    wall = Surface(depth_m + 0.02, 10.0)
    scene = replace(scene, sensor=sensor, markers=(marker,), surfaces=(wall,))
    found = calibrate(Simulation(scene).run(SECONDS)).sweep
    return [] if found is None else [found.blur.value - sensor.blur, found.blur.stddev]
