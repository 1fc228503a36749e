# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rooms: everything in them is drawn from one seed.

Markers send and move, walls stand behind them or wander, hands pass, and the sensor loses frames.
Some markers are foreign: they blink by another clock or in another code, and have no ID.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from evaluation.bench.recordings import SILENCE_BITS, log_uniform, walk
from evaluation.bench.room_markers import (
    FOREIGN,
    INNER,
    MOTIONS,
    SENDINGS,
    Course,
    RoomMarker,
    foreign_ratio,
    room_marker,
)
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Scene, Simulation, optics
from retrolidar_ros.scene.description import (
    MARKER_SIZE_M,
    MovingSurface,
    Response,
    Sensor,
    Surface,
    Waypoint,
)
from retrolidar_ros.scene.optics import received_signal, zone_shares
from retrolidar_ros.scene.reference import NOISE, RANGING
from retrolidar_ros.scene.transmission import exposure_edges
from retrolidar_ros.sensor.frame import GRIDS, Floats, ZoneGrid

_ROOM_BITS = (500, 700)  # how long a room lasts, in bits
_SLOW_BIT_S, _SLOW_PERIOD_S = 0.133, 1 / 15  # of 8x8 zones
_SLOW = 0.12  # share of the rooms
_FULL, _FULL_SEQUENCE = 0.08, 0.5  # rooms with all zones full; of these with other IDs in all
_FOREIGN = 0.2  # rooms in which a marker is foreign
_WOKEN = 0.15  # rooms in which all markers have quartz clocks, and begin to send at once
_BEGINS = 0.3  # markers that send after a silence; others have always been sending
_COMES_AND_GOES = 0.3  # markers that appear or vanish, in mid-packet
_RANGE_M = (0.4, 3.8)
_ZONES_A_PACKET = (0.3, 3.6)  # how fast markers cross: 0.05 to 0.6 m/s at 1 m, in 4x4 zones
# Of markers that repeat: how far they move along the line of sight, and how fast at most.
_ALONG_M, _ALONG_M_S = (0.01, 0.4), (0.02, 0.8)
_MOUNTED = 0.3  # share of their rooms in which all are mounted on what is behind them
_CLOCK_ERROR, _QUARTZ = 0.012, (1e-3, 0.1)  # quartz has such a share of the error


@dataclass(frozen=True)
class Room:
    """A room, and its clock."""

    scene: Scene
    bit_period_s: float  # of a perfect marker
    markers: tuple[RoomMarker, ...]
    cloth: tuple[float, float] = (0.0, 0.0)
    """How far the signals of walls wander, and their steps a frame [kcps/SPAD]."""


class RoomSimulation(Simulation):
    """What the sensor reports of a room, and the light of its markers; for one run."""

    def __init__(self, room: Room, rng: np.random.Generator) -> None:
        """Start a room at its time zero."""
        super().__init__(room.scene, rng)
        self.room = room
        self.middle_s: Floats = np.zeros(0)
        self.bright: Floats = np.zeros(0)  # light of bright markers, shape (markers, frames, zones)
        self.depth_m: Floats = np.zeros(0)  # z of all targets, shape (targets, frames, zones)
        self.others: Floats = np.zeros(0)  # light of surfaces, shape (surfaces, frames, zones)
        self.hidden: Floats = np.zeros(0)  # by hands, shape (markers, frames, zones)

    def targets(self, middle_s: Floats) -> tuple[Floats, Floats]:
        """Return signal and z of every target; the light of bright markers is kept, too."""
        sensor, markers = self.scene.sensor, self.room.markers
        shape = (len(middle_s), sensor.grid.zones)
        edges_s = exposure_edges(middle_s, self.period_s)
        passed = np.array([marker.transmission(edges_s) for marker in markers])
        self.bright = np.empty((len(markers), *shape))
        depth = []
        for index, marker in enumerate(markers):
            position_m = marker.course.positions(middle_s)
            range_m = np.linalg.norm(position_m, axis=1)
            light = received_signal(range_m, MARKER_SIZE_M**2, 0.0)
            light = light * marker.course.brightness(middle_s)
            shares = zone_shares(position_m, MARKER_SIZE_M, sensor.grid, sensor.blur)
            self.bright[index] = light[:, None] * shares
            depth.append(range_m[:, None] * sensor.grid.z_per_range)
        surfaces = []
        for surface in self.scene.surfaces:
            light, z = optics.see_surface(sensor, surface, middle_s)
            on = light > 0
            if self.room.cloth[0]:
                light = light + walk(shape, *self.room.cloth, self._rng)
            surfaces.append(np.broadcast_to(light * on, shape))
            depth.append(z)
        self.hidden = np.zeros_like(self.bright)
        for moving in self.scene.moving_surfaces:
            light, z, hidden = optics.see_moving(sensor, moving, middle_s)
            for index in range(len(markers)):
                behind = np.where(depth[index] > z, hidden, 0.0)
                self.hidden[index] = np.maximum(self.hidden[index], behind)
            surfaces = [
                own * (1 - np.where(far > z, hidden, 0.0))
                for own, far in zip(surfaces, depth[len(markers) :], strict=True)
            ]
            surfaces.append(light)
            depth.append(z)
        self.middle_s = middle_s
        self.others = np.array(surfaces).reshape(len(surfaces), *shape)
        self.depth_m = np.array([np.broadcast_to(one, shape) for one in depth])
        light = self.bright * (1 - self.hidden) * passed[:, :, None]
        return np.concatenate([light, self.others]), self.depth_m


def draw_room(rng: np.random.Generator, *, all_repeat: bool = False) -> Room:
    """Draw a room.

    all_repeat: Markers of ours repeat, those that sway come nearer and go, too, and all may be
    mounted on walls.
    """
    slow = rng.random() < _SLOW
    bit_s = _SLOW_BIT_S if slow else BIT_PERIOD_S
    grid = GRIDS[8, 8] if slow else GRIDS[4, 4]
    duration_s = rng.uniform(*_ROOM_BITS) * bit_s
    full = not slow and rng.random() < _FULL
    places = _places(grid, full, rng)
    crossing = 0.0 if full else rng.choice([0.0, 0.5, 1.0])
    same_sending = SENDINGS[3] if full and rng.random() < _FULL_SEQUENCE else None
    foreign = int(rng.integers(len(places))) if rng.random() < _FOREIGN else -1
    woken, moved = rng.spawn(2)  # so that other rooms stay those of their seeds
    clock, begin_s = 1.0, None
    if woken.random() < _WOKEN:
        clock = log_uniform(_QUARTZ, woken)
        begin_s = bit_s * SILENCE_BITS * woken.uniform(1, 2)
    markers = []
    for index, place_m in enumerate(places):
        sending = same_sending or str(rng.choice(SENDINGS))
        if all_repeat:
            sending = SENDINGS[0]
        if index == foreign:
            sending = str(rng.choice(FOREIGN))
        motion = 'crossing' if rng.random() < crossing else str(rng.choice(MOTIONS[:2]))
        course = _course(motion, place_m, grid, bit_s, rng)
        if all_repeat:
            course = _to_and_fro(course, moved)
        marker = _marker(sending, course, bit_s, duration_s, rng, clock=clock, woken_s=begin_s)
        markers.append(marker)
    sensor = Sensor(
        grid=grid,
        period_s=_SLOW_PERIOD_S if slow else 0.021,
        period_error=float(rng.uniform(-0.005, 0.005)),
        jitter_s=float(rng.choice([0.0, 0.001, 0.003])),
        blur=float(rng.uniform(0.03, 0.1)),
        noise=NOISE,
        ranging=RANGING,
        target_threshold=float(rng.choice([0.0, 2.0])),
        lost=float(rng.choice([0.0, 0.0, rng.uniform(0, 0.3)])),
        abnormal=float(rng.choice([0.0, 0.0, rng.uniform(0, 0.2)])),
    )
    scene = Scene(
        duration_s=duration_s,
        sensor=sensor,
        surfaces=_walls(places, grid, rng, mounted=all_repeat and moved.random() < _MOUNTED),
        moving_surfaces=_hands(duration_s, rng),
    )
    return Room(scene, bit_s, tuple(markers), _cloth(sensor.period_s, rng))


def _places(grid: ZoneGrid, full: bool, rng: np.random.Generator) -> list[Floats]:
    """Return where markers are [m]: anywhere, in one zone, in zones side by side, or in all."""
    if full:
        zones = list(range(grid.zones))
    else:
        count = int(rng.integers(1, 5))
        row, column = rng.integers(grid.rows), rng.integers(grid.columns)
        layout = rng.choice(['anywhere', 'same', 'beside'])
        if layout == 'anywhere':
            zones = rng.choice(grid.zones, count, replace=False).tolist()
        elif layout == 'same':
            zones = [int(row * grid.columns + column)] * min(count, 2)
        else:
            # Of a block of 2x2 zones.
            top, left = min(int(row), grid.rows - 2), min(int(column), grid.columns - 2)
            block = [(top + i) * grid.columns + left + j for i in (0, 1) for j in (0, 1)]
            zones = rng.choice(block, count, replace=False).tolist()
    # Markers that share a zone are about as far, so that the sensor merges them.
    together = len(set(zones)) < len(zones)
    base_m = log_uniform(_RANGE_M, rng)
    places = []
    for zone in zones:
        near = together or (full and rng.random() < 0.5)
        range_m = base_m + rng.uniform(-0.2, 0.2) if near else log_uniform(_RANGE_M, rng)
        tangents = grid.tangents[zone] + grid.pitch * rng.uniform(-0.5, 0.5, 2)
        bound = INNER * grid.view / 2
        ray = np.append(np.clip(tangents, -bound, bound), 1.0)
        places.append(max(range_m, _RANGE_M[0]) * ray / np.linalg.norm(ray))
    return places


def _course(
    motion: str, place_m: Floats, grid: ZoneGrid, bit_s: float, rng: np.random.Generator
) -> Course:
    across_m = log_uniform((0.002, 0.04), rng)
    swings = motion == 'swaying'
    speed = place_m[2] * grid.pitch * log_uniform(_ZONES_A_PACKET, rng) / (PACKET_BITS * bit_s)
    angle = rng.uniform(0, 2 * math.pi)
    return Course(
        motion,
        place_m,
        swing_m=swings * np.array([across_m, across_m * rng.random(), rng.uniform(0, 0.02)]),
        turn_s=rng.uniform(0.8, 4.0, 3),
        speed_m_s=speed * np.array([math.cos(angle), math.sin(angle)]),
        fade=float(swings * rng.uniform(0, 0.4)),
        half=grid.view / 2,
    )


def _marker(
    sending: str,
    course: Course,
    bit_s: float,
    duration_s: float,
    rng: np.random.Generator,
    *,
    clock: float,
    woken_s: float | None,
) -> RoomMarker:
    """Draw what a marker sends; clock: its error, as a share of that of an RC oscillator."""
    bit_s *= 1 + clock * rng.uniform(-_CLOCK_ERROR, _CLOCK_ERROR)
    present = [-math.inf, math.inf]
    if rng.random() < _COMES_AND_GOES:
        present[int(rng.integers(2))] = duration_s * rng.uniform(0.2, 0.8)
    crystal = {
        'response': Response(log_uniform((3e-4, 1e-3), rng), log_uniform((2e-3, 1.5e-2), rng)),
        'contrast': float(rng.uniform(0.7, 1.0)),
        'present_s': (present[0], present[1]),
    }
    begin_s = -PACKET_BITS * bit_s * rng.random()
    if sending == 'period':
        bit_s *= foreign_ratio(rng)
    if sending == 'lone' or (sending in SENDINGS and rng.random() < _BEGINS):
        begin_s = bit_s * (SILENCE_BITS + 4 * PACKET_BITS * rng.random())
    if woken_s is not None and sending in SENDINGS:
        begin_s = woken_s
    return room_marker(sending, course, bit_s, begin_s, duration_s, rng, **crystal)


def _to_and_fro(course: Course, rng: np.random.Generator) -> Course:
    """Return a course that is also to and from the sensor, if it sways."""
    along_m = log_uniform(_ALONG_M, rng)
    turn_s = 2 * math.pi * along_m / log_uniform(_ALONG_M_S, rng)
    if course.motion != MOTIONS[1]:
        return course
    return replace(
        course,
        swing_m=np.append(course.swing_m[:2], min(along_m, course.place_m[2] / 3)),
        turn_s=np.append(course.turn_s[:2], turn_s),
    )


def _walls(
    places: list[Floats], grid: ZoneGrid, rng: np.random.Generator, *, mounted: bool
) -> tuple[Surface, ...]:
    """Return a wall close behind the markers, far behind, or none; mounted: on which they are."""
    farthest_m = max(float(place[2]) for place in places)
    kind = rng.choice(['near', 'near', 'far', 'own', 'none'])
    if mounted:
        kind = 'own'
    if kind == 'none':
        return ()
    signal = log_uniform((1.0, 15.0), rng)
    if kind != 'own':
        behind_m = rng.uniform(0.02, 0.4) if kind == 'near' else rng.uniform(0.7, 2.0)
        return (Surface(farthest_m + behind_m, signal),)
    # Each marker is on something that fills its zone, and the wall is behind all others.
    depths = np.full(grid.zones, farthest_m + rng.uniform(0.02, 1.0))
    for place in places:
        zone = np.abs(grid.tangents - place[:2] / place[2]).max(axis=1).argmin()
        depths[zone] = place[2] + (0.002 if mounted else 0.02)
    return tuple(Surface(float(z), signal, (zone,)) for zone, z in enumerate(depths))


def _hands(duration_s: float, rng: np.random.Generator) -> tuple[MovingSurface, ...]:
    """Return a hand that passes now and then, or none."""
    if rng.random() < 0.7:
        return ()
    z = rng.uniform(0.15, 0.35)
    points, time_s, side = [], 0.0, 1.0
    aside_m = 1.5 * z
    while time_s < duration_s:
        y = float(rng.uniform(-0.2, 0.2) * z)
        points.append(Waypoint(time_s, (side * aside_m, y, z)))
        time_s += rng.uniform(1.5, 8.0)
        points.append(Waypoint(time_s, (side * aside_m, y, z)))
        time_s += rng.uniform(0.3, 1.5)
        side = -side
    return (MovingSurface(float(rng.uniform(0.06, 0.1)), 60.0, tuple(points)),)


def _cloth(period_s: float, rng: np.random.Generator) -> tuple[float, float]:
    """Return how far the signals of walls wander, and their steps a frame; 0 = not at all."""
    if rng.random() < 0.7:
        return (0.0, 0.0)
    bound = log_uniform((1.0, 20.0), rng)
    return (bound, rng.uniform(0.05, 0.4) * bound * math.sqrt(period_s / 0.5))
