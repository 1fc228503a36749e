# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A phone's full-HD camera that looks at a flat plate before a cluttered background.

It is a pinhole, blur, exposure and noise.

The camera frame is optical: x right, y down, z forward. A point of the picture is in pixels from
its upper left corner, so the pixel in row i and column j covers i to i + 1 and j to j + 1. Light
is in shares of what white paper sends. Left out are lens distortion, colour, a phone's noise
reduction and video compression, as of a calibrated camera.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evaluation.bench.places import rotation
from retrolidar_ros.sensor.frame import Floats

WIDTH, HEIGHT = 1920, 1080
PICTURES_HZ = 30.0
HALF_FIELD_OF_VIEW_RAD = math.radians(25)  # paper §6.3 names no axis; across favours the tags
FOCAL_PX = WIDTH / 2 / math.tan(HALF_FIELD_OF_VIEW_RAD)
CENTRE_PX = (WIDTH / 2, HEIGHT / 2)
INTRINSICS = np.array([[FOCAL_PX, 0, CENTRE_PX[0]], [0, FOCAL_PX, CENTRE_PX[1]], [0, 0, 1]])

BLUR_PX = 0.7
"""Deviation of the Gaussian that lens and demosaicing spread a point to.

Our assumption. With the pixel's own area it leaves half the contrast at a quarter of a cycle per
pixel, half the Nyquist frequency.
"""
_BLUR_RADIUS = 4
_ALIGNMENT = 8  # of windows, a multiple of the tiles in which AprilTag 3 thresholds
_SURROUNDINGS_PX = 40
_SUBSAMPLES = 4  # a pixel's side
_LEAVES = 60_000
_LEAF_RADII_PX = (3.0, 300.0)

# A sensor of the 1/2-inch class, 6.4 mm wide, binned to 1920 columns, behind a lens of a phone's
# usual aperture. Full well and read noise are those of four binned pixels of 1.6 µm.
_PIXEL_M = 6.4e-3 / WIDTH
_F_NUMBER = 1.8
_TRANSMISSION = 0.9
_QUANTUM_EFFICIENCY = 0.5
_FULL_WELL_E = 20_000.0
_READ_NOISE_E = 5.0
LONGEST_EXPOSURE_S = 1 / PICTURES_HZ
_MAX_GAIN = 64.0  # ISO 6400 where the full well is ISO 100
_WHITE_LEVEL = 0.8  # where auto exposure puts white paper, as a share of the brightest level
_PAPER_REFLECTANCE = 0.9

# All light counted as of 555 nm, where a lumen is 1/683 W (definition of the candela).
_PHOTONS_PER_LUMEN_S = 555e-9 / (683 * 6.62607015e-34 * 2.99792458e8)


def paper_electrons(illuminance_lux: float, exposure_s: float) -> float:
    """Return the photoelectrons that white paper leaves in a pixel.

    A matt surface of reflectance r sends the luminance L = r·E/π, and the picture of it receives
    π·L·T/(4·N²) with transmission T and f-number N.
    """
    luminance = _PAPER_REFLECTANCE * illuminance_lux / math.pi
    picture_lux = math.pi * luminance * _TRANSMISSION / (4 * _F_NUMBER**2)
    photons = picture_lux * _PIXEL_M**2 * exposure_s * _PHOTONS_PER_LUMEN_S
    return _QUANTUM_EFFICIENCY * photons


def expose(
    light: Floats,
    illuminance_lux: float,
    rng: np.random.Generator,
    *,
    veil: float = 0.0,
    longest_s: float = LONGEST_EXPOSURE_S,
) -> NDArray[np.uint8]:
    """Return the picture of a scene: 8-bit grey levels, of the shape of the light.

    Light, and a veil of glare over all that the exposure does not follow, are in shares of white
    paper. Exposure time, up to the longest, and gain are set to the illuminance. Shot noise is
    Gaussian, as for many electrons.
    """
    target = _WHITE_LEVEL * _FULL_WELL_E
    white = min(paper_electrons(illuminance_lux, longest_s), target)
    gain = min(target / white, _MAX_GAIN)
    electrons = (white * (light + veil)).astype(np.float32)
    deviation = np.sqrt(electrons + np.float32(_READ_NOISE_E**2))
    electrons += deviation * rng.standard_normal(light.shape, dtype=np.float32)
    levels = np.clip(electrons * np.float32(gain / _FULL_WELL_E), 0, 1)
    picture: NDArray[np.uint8] = np.rint(255 * levels).astype(np.uint8)
    return picture


def exposure_s(illuminance_lux: float, longest_s: float = LONGEST_EXPOSURE_S) -> float:
    """Return how long the camera exposes [s]."""
    full = paper_electrons(illuminance_lux, longest_s)
    return longest_s * min(1.0, _WHITE_LEVEL * _FULL_WELL_E / full)


def smear(light: Floats, length_px: float) -> Floats:
    """Spread light along the rows by a motion of some pixels during the exposure."""
    whole = math.floor(length_px)
    weights = np.append(np.ones(whole), length_px - whole)
    if length_px <= 1:
        weights = np.array([1.0, length_px]) / (1 + length_px)
    padded = np.pad(light, ((0, 0), (len(weights) // 2, len(weights))), mode='edge')
    return _weighted(padded.T, weights / weights.sum(), light.shape[1]).T


class Pose(NamedTuple):
    """Where a plate is, in the camera's frame."""

    position_m: Floats  # of its centre, shape (3,)
    rotation: Floats  # its axes as columns: right, down, and away from the camera, shape (3, 3)

    @property
    def homography(self) -> Floats:
        """From the plate's right and down [m] to the picture [pixels], shape (3, 3)."""
        return INTRINSICS @ np.column_stack([self.rotation[:, :2], self.position_m])


def transform(homography: Floats, points: ArrayLike) -> Floats:
    """Map points of a plane, shape (..., 2), by a homography."""
    points = np.asarray(points, dtype=float)
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return mapped[..., :2] / mapped[..., 2:]


def facing(position_m: Floats, roll_rad: float = 0.0) -> Pose:
    """Return a plate at a place, shape (3,) [m], that faces the origin."""
    away = position_m / np.linalg.norm(position_m)
    level = np.cross([0.0, 1.0, 0.0], away)
    level /= np.linalg.norm(level)
    right = math.cos(roll_rad) * level + math.sin(roll_rad) * np.cross(away, level)
    return Pose(position_m, np.column_stack([right, np.cross(away, right), away]))


def facing_pose(
    range_m: float, margin_px: float, max_roll_rad: float, rng: np.random.Generator
) -> Pose:
    """Return a plate at a range [m] that faces the camera, a little rolled [rad] either way.

    Its place in the picture is random, with its centre a margin away from the edges [pixels].
    """
    place = rng.uniform(margin_px, np.array([WIDTH, HEIGHT]) - margin_px)
    ray = np.append((place - CENTRE_PX) / FOCAL_PX, 1.0)
    position_m = range_m / np.linalg.norm(ray) * ray
    return facing(position_m, rng.uniform(-max_roll_rad, max_roll_rad))


def tilted(pose: Pose, yaw_rad: float, pitch_rad: float) -> Pose:
    """Return a plate turned away about its own vertical and horizontal axes."""
    return pose._replace(rotation=pose.rotation @ rotation(yaw_rad, pitch_rad, 0.0))


def blur(light: Floats) -> Floats:
    """Spread light by the camera's Gaussian, shape (rows, columns); it is dark outside."""
    steps = np.arange(-_BLUR_RADIUS, _BLUR_RADIUS + 1)
    kernel = np.exp(-0.5 * (steps / BLUR_PX) ** 2)
    kernel /= kernel.sum()
    for _ in range(2):
        padded = np.pad(light, ((_BLUR_RADIUS, _BLUR_RADIUS), (0, 0)))
        light = _weighted(padded, kernel, len(light)).T
    return light


def _weighted(padded: Floats, weights: Floats, rows: int) -> Floats:
    """Return the weighted sum of an array that is shifted by one row after the other."""
    shifted = (weight * padded[index : index + rows] for index, weight in enumerate(weights))
    return sum(shifted, np.zeros((rows, padded.shape[1])))


def dead_leaves(rng: np.random.Generator) -> Floats:
    """Return a cluttered background, shape (HEIGHT, WIDTH), in shares of white paper.

    Discs that hide one another, of random greys and with the density of radii falling by their
    third power, have the statistics of natural pictures (Lee, Mumford and Huang 2001).
    """
    smallest, largest = _LEAF_RADII_PX
    falls = 1 - rng.uniform(size=_LEAVES) * (1 - (smallest / largest) ** 2)
    radii = smallest / np.sqrt(falls)
    rows, columns = rng.uniform((-largest,), np.array([[HEIGHT], [WIDTH]]) + largest, (2, _LEAVES))
    greys = rng.uniform(0.05, 1.0, _LEAVES)
    picture = np.full((HEIGHT, WIDTH), 0.5)
    for row, column, radius, grey in zip(rows, columns, radii, greys, strict=True):
        top, left = max(0, int(row - radius)), max(0, int(column - radius))
        part = picture[top : max(0, int(row + radius) + 1), left : max(0, int(column + radius) + 1)]
        y = np.arange(top, top + part.shape[0]) + 0.5 - row
        x = np.arange(left, left + part.shape[1]) + 0.5 - column
        part[y[:, None] ** 2 + x**2 < radius**2] = grey
    return picture


class Window(NamedTuple):
    """A part of the picture, as what cuts it out [pixels]."""

    rows: slice
    columns: slice

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the optical axis is, from the window's upper left corner."""
        return CENTRE_PX[0] - self.columns.start, CENTRE_PX[1] - self.rows.start


def _window(side_m: float, pose: Pose, margin_px: int, alignment_px: int) -> Window:
    """Return what holds a plate and a margin, with edges at multiples of the alignment."""
    half = side_m / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    places = transform(pose.homography, corners)
    low = np.floor((places.min(axis=0) - margin_px) / alignment_px) * alignment_px
    high = np.ceil((places.max(axis=0) + margin_px) / alignment_px) * alignment_px
    left, top = np.maximum(low, 0).astype(int)
    right, bottom = np.minimum(high, [WIDTH, HEIGHT]).astype(int)
    return Window(slice(int(top), int(bottom)), slice(int(left), int(right)))


class Background:
    """What is behind the plate, the same for all pictures of a series."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._sharp = dead_leaves(rng)
        self.light = blur(self._sharp)
        """As the camera sees it without a plate, shape (HEIGHT, WIDTH)."""

    def with_plate(self, cells: Floats, side_m: float, pose: Pose) -> tuple[Floats, Window]:
        """Return the light of the pixels around a plate, and the window that they are.

        The plate has square cells in shares of white paper, shape (n, n), and an edge [m].
        """
        window = _window(side_m, pose, _SURROUNDINGS_PX, _ALIGNMENT)
        inner = _window(side_m, pose, 1, 1)
        top, left = inner.rows.start, inner.columns.start
        sharp = self._sharp[inner]
        rows, columns = sharp.shape
        x = left + (np.arange(columns * _SUBSAMPLES) + 0.5) / _SUBSAMPLES
        y = top + (np.arange(rows * _SUBSAMPLES) + 0.5) / _SUBSAMPLES
        to_plate = np.linalg.inv(pose.homography)[:, :, None, None]
        right, down, scale = to_plate[:, 0] * x + to_plate[:, 1] * y[:, None] + to_plate[:, 2]
        column = np.floor(len(cells) * (right / scale / side_m + 0.5)).astype(int)
        row = np.floor(len(cells) * (down / scale / side_m + 0.5)).astype(int)
        inside = (row >= 0) & (row < len(cells)) & (column >= 0) & (column < len(cells))
        light = np.zeros(inside.shape)
        light[inside] = cells[row[inside], column[inside]]
        seen = self.light[window]
        change = np.zeros(seen.shape)
        part = change[top - window.rows.start :, left - window.columns.start :][:rows, :columns]
        part += _pixel_means(light) - _pixel_means(inside) * sharp
        return seen + blur(change), window


def _pixel_means(samples: NDArray[Any]) -> Floats:
    rows, columns = np.array(samples.shape) // _SUBSAMPLES
    means: Floats = samples.reshape(rows, _SUBSAMPLES, columns, _SUBSAMPLES).mean(axis=(1, 3))
    return means
