# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is behind a visual marker in a picture, and the light around the marker."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.peers.camera import CENTRE_PX, HEIGHT, WIDTH, Pose, blur, transform
from retrolidar_ros.sensor.frame import Floats

_ALIGNMENT = 8  # of windows, a multiple of the tiles in which AprilTag 3 thresholds
_SURROUNDINGS_PX = 40
_SUBSAMPLES = 4  # a pixel's side
_LEAVES = 60_000
_LEAF_RADII_PX = (3.0, 300.0)


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
    """A part of the picture [pixels]."""

    top: int
    left: int
    bottom: int
    right: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """What cuts it out of a picture."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    @property
    def centre_px(self) -> tuple[float, float]:
        """Where the optical axis is, from the window's upper left corner."""
        return CENTRE_PX[0] - self.left, CENTRE_PX[1] - self.top


def _window(side_m: float, pose: Pose, margin_px: int, alignment_px: int) -> Window:
    """Return what holds a plate and a margin, with edges at multiples of the alignment."""
    half = side_m / 2
    corners = [(-half, -half), (half, -half), (half, half), (-half, half)]
    places = transform(pose.homography, corners)
    low = np.floor((places.min(axis=0) - margin_px) / alignment_px) * alignment_px
    high = np.ceil((places.max(axis=0) + margin_px) / alignment_px) * alignment_px
    left, top = np.maximum(low, 0).astype(int)
    right, bottom = np.minimum(high, [WIDTH, HEIGHT]).astype(int)
    return Window(int(top), int(left), int(bottom), int(right))


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
        sharp = self._sharp[inner.slices]
        rows, columns = sharp.shape
        x = inner.left + (np.arange(columns * _SUBSAMPLES) + 0.5) / _SUBSAMPLES
        y = inner.top + (np.arange(rows * _SUBSAMPLES) + 0.5) / _SUBSAMPLES
        to_plate = np.linalg.inv(pose.homography)[:, :, None, None]
        right, down, scale = to_plate[:, 0] * x + to_plate[:, 1] * y[:, None] + to_plate[:, 2]
        column = np.floor(len(cells) * (right / scale / side_m + 0.5)).astype(int)
        row = np.floor(len(cells) * (down / scale / side_m + 0.5)).astype(int)
        inside = (row >= 0) & (row < len(cells)) & (column >= 0) & (column < len(cells))
        light = np.zeros(inside.shape)
        light[inside] = cells[row[inside], column[inside]]
        change = np.zeros((window.bottom - window.top, window.right - window.left))
        part = change[inner.top - window.top :, inner.left - window.left :][:rows, :columns]
        part += _pixel_means(light) - _pixel_means(inside) * sharp
        return self.light[window.slices] + blur(change), window


def _pixel_means(samples: NDArray[Any]) -> Floats:
    """Return the means of the samples in each pixel."""
    rows, columns = np.array(samples.shape) // _SUBSAMPLES
    means: Floats = samples.reshape(rows, _SUBSAMPLES, columns, _SUBSAMPLES).mean(axis=(1, 3))
    return means
