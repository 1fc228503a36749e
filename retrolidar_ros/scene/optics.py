# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Light in a scene: how much of a marker's comes back, to which zones, and what disturbs it.

Sensors move, hands pass, and there is much light.
"""

import math

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.scene.description import (
    NEAREST_M,
    SIGNAL_AT_1_M,
    Marker,
    MovingSurface,
    Sensor,
    Surface,
    Waypoint,
)
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

REFERENCE_AREA_M2 = 9e-4
DISTANCE_EXPONENT = -3.8  # measured beyond 1.5 m (paper Fig. 5a)
# Signal declines rapidly beyond 50° of yaw and is gone at 60° (paper Fig. 11b).
_YAW_GOOD_RAD = math.radians(50)
_YAW_DEAD_RAD = math.radians(60)


def received_signal(
    range_m: Floats, area_m2: float, yaw_rad: float, signal_at_1_m: float = SIGNAL_AT_1_M
) -> Floats:
    """Return the signal [kcps/SPAD] of a bright marker wholly within one zone.

    Its retroreflector is at radial distances of shape (...) and turned by `yaw_rad` from the line
    of sight; `signal_at_1_m` is that of one of 3 cm that faces the sensor.
    """
    decline = (_YAW_DEAD_RAD - abs(yaw_rad)) / (_YAW_DEAD_RAD - _YAW_GOOD_RAD)
    facing = math.cos(yaw_rad) * min(1.0, max(0.0, decline))
    at_1_m = signal_at_1_m * area_m2 / REFERENCE_AREA_M2 * facing
    return at_1_m * range_m**DISTANCE_EXPONENT


def along(path: tuple[Waypoint, ...], time_s: Floats) -> tuple[Floats, Floats]:
    """Return positions [m], shape (n, 3), and angles (yaw, pitch) [rad], shape (n, 2), at times."""
    times = np.array([point.time_s for point in path])
    span_s = times[-1] - times[0]
    since = times[0] + np.mod(time_s - times[0], span_s) if span_s else np.full_like(time_s, 0.0)
    places = np.array([(*point.position_m, point.yaw_rad, point.pitch_rad) for point in path])
    pose = np.stack([np.interp(since, times, column) for column in places.T], axis=-1)
    return pose[:, :3], pose[:, 3:]


def position_at(marker: Marker, time_s: Floats) -> Floats:
    """Return where a marker is at times (n,): x, y, z [m], shape (n, 3), or (1, 3) if at rest."""
    if marker.path:
        return along(marker.path, time_s)[0]
    rest = np.array(marker.position_m)
    if marker.wander is None:
        return rest[None]
    wander = marker.wander
    turn = 2 * math.pi / wander.period_s * time_s
    golden = (1 + math.sqrt(5)) / 2
    across_x = wander.across_m * np.sin(turn)
    across_y = wander.across_m * np.sin(turn / golden + 1)
    along_z = wander.along_m * np.sin(turn / math.sqrt(2) + 2)
    position: Floats = rest + np.stack([across_x, across_y, along_z], axis=-1)
    return position


def _ramp(distance: Floats, sigma: Floats | float) -> Floats:
    """Integrate the cumulative normal distribution, or the unit step where sigma is 0."""
    if np.all(sigma == 0):
        return np.maximum(distance, 0.0)
    scaled = distance / sigma
    # numpy has no error function, and numpy.vectorize takes twice as long.
    erf = np.array([math.erf(one) for one in (scaled / math.sqrt(2)).ravel().tolist()])
    cumulative = (1 + erf.reshape(scaled.shape)) / 2
    density = np.exp(-scaled * scaled / 2) / math.sqrt(2 * math.pi)
    return sigma * (scaled * cumulative + density)


def line_shares(
    centre: Floats, width: Floats, steps: int, pitch: float, sigma: Floats | float
) -> Floats:
    """Share lines of centre and width (n,), blurred by `sigma`, between steps: (n, steps)."""
    edges = pitch * (np.arange(steps + 1) - steps / 2)
    beyond = edges - centre[:, None]
    half = width[:, None] / 2
    below = (_ramp(beyond + half, sigma) - _ramp(beyond - half, sigma)) / width[:, None]
    return np.diff(below, axis=-1)


def zone_shares(position_m: Floats, size_m: float, grid: ZoneGrid, blur: float) -> Floats:
    """Return the share of a square marker's light that falls into each zone, shape (n, zones).

    Shares sum to 1 where the whole spot is within the field of view. The marker is at positions of
    shape (n, 3); blur is its standard deviation as a share of a zone's width.
    """
    depth = position_m[:, 2]
    width = size_m / depth
    sigma = blur * grid.pitch
    across = line_shares(position_m[:, 0] / depth, width, grid.columns, grid.pitch, sigma)
    down = line_shares(position_m[:, 1] / depth, width, grid.rows, grid.pitch, sigma)
    return (down[:, :, None] * across[:, None, :]).reshape(len(position_m), grid.zones)


def seen_from(sensor: Sensor, position_m: Floats, time_s: Floats) -> Floats:
    """Return positions of the scene, shape (n or 1, 3), in the frame of a sensor that moves [m]."""
    if not sensor.path:
        return position_m
    own_m, turned = along(sensor.path, time_s)
    seen: Floats = np.einsum('nji,nj->ni', rotation_of(turned), position_m - own_m)
    return seen


def rotation_of(turned: Floats) -> Floats:
    """Return the matrices, shape (n, 3, 3), that turn directions of the sensor into the scene's."""
    (sin_y, sin_p), (cos_y, cos_p) = np.sin(turned).T, np.cos(turned).T
    zero = np.zeros_like(sin_y)
    rows = [
        [cos_y, sin_y * sin_p, sin_y * cos_p],
        [zero, cos_p, -sin_p],
        [-sin_y, cos_y * sin_p, cos_y * cos_p],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def in_front(position_m: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return positions that are before the sensor, and, shape (n, 1), whether they were so."""
    ahead: NDArray[np.bool_] = position_m[:, 2:] > NEAREST_M
    return np.where(ahead, position_m, (0.0, 0.0, 1.0)), ahead


def see_surface(sensor: Sensor, surface: Surface, time_s: Floats) -> tuple[Floats, Floats]:
    """Return signal [kcps/SPAD] and z [m] of a flat wall in each zone, shape (n or 1, zones).

    A ray of the sensor meets it where its depth in the scene is the wall's; the signal of what
    fills a zone falls with the square of the distance.
    """
    zones = sensor.grid.zones
    signal = np.zeros((1, zones))
    signal[:, slice(None) if surface.zones is None else list(surface.zones)] = surface.signal
    if not sensor.path:
        return signal, np.full((1, zones), surface.distance_m)
    own_m, turned = along(sensor.path, time_s)
    rays = np.column_stack([sensor.grid.tangents, np.ones(zones)])
    forward = rotation_of(turned)[:, 2] @ rays.T
    depth = (surface.distance_m - own_m[:, 2:]) / np.maximum(forward, 1e-3)
    depth = np.maximum(depth, NEAREST_M)
    return signal * (surface.distance_m / depth) ** 2, depth


def see_moving(
    sensor: Sensor, surface: MovingSurface, time_s: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return signal [kcps/SPAD], z [m] and how much of each zone it hides, shape (n, zones)."""
    place = seen_from(sensor, along(surface.path, time_s)[0], time_s)
    place, ahead = in_front(place)
    depth = place[:, 2:]
    filled = (surface.width_m / depth / sensor.grid.pitch) ** 2
    hidden = zone_shares(place, surface.width_m, sensor.grid, sensor.blur) * filled * ahead
    hidden = np.clip(hidden, 0.0, 1.0)
    return surface.signal / depth**2 * hidden, depth, hidden


def saturated(signal: Floats, ambient: Floats | float, limit: float) -> Floats:
    """Return what counters make of rates [kcps/SPAD], up to their limit, one over the dead time.

    More light does not lengthen that: n / (1 + n·dead time) of n (Knoll, *Radiation Detection and
    Measurement*, ch. 4).
    """
    return signal / (1 + (signal + ambient) / limit)
