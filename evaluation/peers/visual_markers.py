# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The visual markers of paper Table 4 and what reads them: AprilTag 3, and zbar for QR codes.

A marker's size is the edge of its pattern. The plate that carries it adds a white margin.
"""

import ctypes
import re
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from evaluation.peers.camera import FOCAL_PX
from retrolidar_ros.sensor.frame import Floats

IDS = 2115  # how many IDs tagStandard41h12 has
APRILTAG, APRILTAG_FINE, QR = 'AprilTag', 'AprilTag, all pixels', 'QR code'
_FAMILY = 'tagStandard41h12'
_INK = 0.05  # in shares of white paper
_SQUARE = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) - 0.5


class Plate(NamedTuple):
    """A marker with its margin."""

    cells: Floats  # in shares of white paper, shape (n, n)
    side_m: float  # edge, with the margin [m]


class Sighting(NamedTuple):
    """A marker that was read in a picture."""

    id: int
    range_m: float  # to its centre, radially


def _plate(white: NDArray[np.bool_], size_m: float, margin: int) -> Plate:
    """Return a pattern with a white margin of some cells."""
    cells = np.pad(np.where(white, 1.0, _INK), margin, constant_values=1.0)
    return Plate(cells, size_m * len(cells) / len(white))


class AprilTagReader:
    """Tags read by AprilTag 3, which seeks squares in `quad_decimate` times fewer pixels a side.

    Markers have a size [m] and pictures grey levels; the optical axis is at a centre [pixels].
    """

    kind = APRILTAG

    def __init__(self, name: str, quad_decimate: float, threads: int = 1) -> None:
        from pyapriltags import Detector

        self.name = name
        self.detector: Any = Detector(_FAMILY, nthreads=threads, quad_decimate=quad_decimate)
        # The library's own default, which the Python binding cuts down to the integer 0.
        self.detector.tag_detector_ptr.contents.decode_sharpening = 0.25
        family = self.detector.tag_families[_FAMILY].contents
        # A pose is that of the border, which this family has inside its outer ring of bits.
        self.border = family.width_at_border / family.total_width

    def plate(self, identity: int, size_m: float) -> Plate:
        """Return a tag of 9 × 9 cells with a margin of one."""
        from pyapriltags.apriltags import _ImageU8

        library = self.detector.libc
        library.apriltag_to_image.restype = ctypes.POINTER(_ImageU8)
        drawn = library.apriltag_to_image(self.detector.tag_families[_FAMILY], identity)
        image = drawn.contents
        levels = np.ctypeslib.as_array(image.buf, (image.height, image.stride))
        white = levels[:, : image.width] > 0
        library.image_u8_destroy(drawn)
        return _plate(white, size_m, 1)

    def read(
        self, picture: NDArray[np.uint8], centre_px: tuple[float, float], size_m: float
    ) -> list[Sighting]:
        """Read tags; ranges are of corners, for the library's own pose is no better and prints."""
        return [
            Sighting(tag.tag_id, square_range(tag.corners, centre_px, size_m * self.border))
            for tag in self.detector.detect(picture)
        ]


class QrReader:
    """QR codes of version 1-M, which hold 16 bytes, read by zbar; ImportError without it."""

    name = QR
    kind = QR

    def __init__(self) -> None:
        import segno
        from pyzbar import pyzbar

        self._make = segno.make
        self._zbar = pyzbar

    def plate(self, identity: int, size_m: float) -> Plate:
        """Return a code of 21 × 21 modules with the quiet zone of four (ISO/IEC 18004)."""
        code = self._make(f'{identity:04d}', version=1, error='m', boost_error=False, micro=False)
        dark = np.array([list(row) for row in code.matrix], dtype=bool)
        return _plate(~dark, size_m, 4)

    def read(
        self, picture: NDArray[np.uint8], centre_px: tuple[float, float], size_m: float
    ) -> list[Sighting]:
        """Read codes; the range comes from the four corners that zbar gives."""
        codes = self._zbar.decode(picture, symbols=[self._zbar.ZBarSymbol.QRCODE])
        return [
            Sighting(int(code.data), square_range(np.array(code.polygon), centre_px, size_m))
            for code in codes
            if len(code.polygon) == 4 and re.fullmatch(rb'\d{4}', code.data)
        ]


Reader: TypeAlias = AprilTagReader | QrReader
"""Makes a kind of marker, and reads it; readers of one kind can read the same pictures."""


def square_range(corners_px: NDArray[Any], centre_px: tuple[float, float], size_m: float) -> float:
    """Return the range [m] of a square of an edge [m] from its corners in a picture, shape (4, 2).

    They are in their order round the square; the optical axis is at the centre [pixels].
    From far away a square is seen as a parallelogram, whose larger scale is not foreshortened
    (scaled orthography, DeMenthon and Davis 1995). With corners that are off by part of a pixel
    this is steadier than a full homography, whose perspective such a small square does not show.
    """
    rays = np.column_stack([(corners_px - np.array(centre_px)) / FOCAL_PX, np.ones(4)])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    away = rays.mean(axis=0)
    away /= np.linalg.norm(away)
    seen = rays / (rays @ away)[:, None] - away
    # Least squares: the corners of a unit square are ±½, so their squares add up to 1 each way.
    scales = np.linalg.svd(_SQUARE.T @ seen, compute_uv=False)
    return float(size_m / scales[0])


def find_readers() -> tuple[list[Reader], dict[str, str]]:
    """Return what can be read here, and why what cannot be is left out, by name."""
    readers: list[Reader] = []
    missing = {}

    def add(name: str, make: Callable[[], Reader], remedy: str) -> None:
        try:
            readers.append(make())
        except ImportError as error:
            missing[name] = f'{error} ({remedy})'

    remedy = 'pip install pyapriltags'
    add(APRILTAG, lambda: AprilTagReader(APRILTAG, 2.0), remedy)
    add(APRILTAG_FINE, lambda: AprilTagReader(APRILTAG_FINE, 1.0), remedy)
    add(QR, QrReader, 'pip install pyzbar segno, and apt install libzbar0')
    return readers, missing
