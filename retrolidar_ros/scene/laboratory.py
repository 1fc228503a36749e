# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What happens to sensors in labs: they move, hands pass, and there is much light."""

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.scene.description import NEAREST_M, MovingSurface, Sensor, Surface
from retrolidar_ros.scene.optics import along, zone_shares
from retrolidar_ros.sensor.frame import Floats


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
