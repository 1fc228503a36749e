# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The visual markers of paper Table 4, what reads them, and what is made of pictures of them.

AprilTags are read by AprilTag 3, QR codes by zbar.
A marker's size is the edge of its pattern. The plate that carries it adds a white margin.
"""

import ctypes
import math
import re
import time
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pyapriltags import Detector
from pyapriltags.apriltags import _ImageU8

from evaluation.bench.places import median_mm, rms_mm
from evaluation.bench.rates import rate
from evaluation.bench.recordings import rng_at
from evaluation.peers import camera
from evaluation.peers.camera import FOCAL_PX, Background, Window
from retrolidar_ros.sensor.frame import Floats

IDS = 2115  # how many IDs tagStandard41h12 has
APRILTAG, APRILTAG_FINE, QR = 'AprilTag', 'AprilTag, all pixels', 'QR code'
_FAMILY = 'tagStandard41h12'
_INK = 0.05  # in shares of white paper
PICTURES, QUICK_PICTURES = 64, 8  # of a marker of 3 cm at a range
_MAX_ROLL_RAD = math.radians(10)
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

    def __init__(self, name: str = APRILTAG, quad_decimate: float = 2.0, threads: int = 1) -> None:
        self.name = name
        self.detector: Any = Detector(_FAMILY, nthreads=threads, quad_decimate=quad_decimate)
        # The library's own default, which the Python binding cuts down to the integer 0.
        self.detector.tag_detector_ptr.contents.decode_sharpening = 0.25
        family = self.detector.tag_families[_FAMILY].contents
        # A pose is that of the border, which this family has inside its outer ring of bits.
        self.border = family.width_at_border / family.total_width

    def plate(self, identity: int, size_m: float) -> Plate:
        """Return a tag of 9 × 9 cells with a margin of one."""
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
    """Return the readers, and why that of QR codes is missing if zbar is not installed, by name."""
    tags = [AprilTagReader(), AprilTagReader(APRILTAG_FINE, 1.0)]
    try:
        return [*tags, QrReader()], {}
    except ImportError as error:
        return [*tags], {QR: f'{error} (pip install pyzbar segno, and apt install libzbar0)'}


class View(NamedTuple):
    """How a marker is seen."""

    range_m: float
    size_m: float = 0.03  # edge of the pattern
    lux: float = 300.0  # a room with its lamps on
    veil: float = 0.0  # of glare, in shares of white paper
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    speed_m_s: float = 0.0  # across the line of sight
    longest_s: float = camera.LONGEST_EXPOSURE_S  # exposure that the camera takes at most


Result = dict[str, Any]
"""What a reader made of pictures: the `right` and `wrong` ones as rates, and `error_mm`."""


def errors(errors_m: Sequence[float]) -> dict[str, float | None] | None:
    """Return statistics of the sizes of errors [m] in millimetres, None without any."""
    sizes = 1000 * np.abs(errors_m)
    if not len(sizes):
        return None
    worst = {'largest': float(sizes.max()), 'above_1_cm': float(np.mean(sizes > 10))}
    return {'median': median_mm(errors_m), 'rms': rms_mm(errors_m), **worst}


def read_pictures(
    readers: Sequence[Reader],
    background: Background,
    pictures: int,
    rng: np.random.Generator,
    view: View,
) -> dict[str, Result]:
    """Take pictures of markers at random places of the camera's view, and let all read them.

    Readers of one kind of marker get the same pictures.
    """
    hits, wrong = Counter[str](), Counter[str]()
    errors_m: dict[str, list[float]] = {reader.name: [] for reader in readers}
    for _, group in groupby(readers, key=attrgetter('kind')):
        alike = list(group)
        for _ in range(pictures):
            identity = int(rng.integers(IDS))
            light, window = _marker_before(background, alike[0], identity, view, rng)
            picture = camera.expose(light, view.lux, rng, veil=view.veil, longest_s=view.longest_s)
            for reader in alike:
                sightings = reader.read(picture, window.centre_px, view.size_m)
                right = [seen.range_m - view.range_m for seen in sightings if seen.id == identity]
                hits[reader.name] += bool(right)
                wrong[reader.name] += len(sightings) > len(right)
                errors_m[reader.name] += right

    return {
        name: {
            'right': rate(hits[name], pictures),
            'wrong': rate(wrong[name], pictures),
            'error_mm': errors(off_m),
        }
        for name, off_m in errors_m.items()
    }


def read_over_distance(
    readers: Sequence[Reader], ranges_m: Sequence[float], seed: int, *, quick: bool
) -> list[dict[str, Result]]:
    """Return what readers make of markers of 3 cm at some ranges [m].

    At a range every experiment has the same pictures, so a reader's reach is the same in all.
    """
    background = Background(np.random.default_rng(seed))
    pictures = QUICK_PICTURES if quick else PICTURES
    return [
        read_pictures(readers, background, pictures, rng_at(seed, at), View(at)) for at in ranges_m
    ]


def _marker_before(
    background: Background, reader: Reader, identity: int, view: View, rng: np.random.Generator
) -> tuple[Floats, Window]:
    """Return the light around a marker at a random place, wholly in the picture."""
    plate = reader.plate(identity, view.size_m)
    margin_px = FOCAL_PX * plate.side_m / view.range_m
    pose = camera.facing_pose(view.range_m, margin_px, _MAX_ROLL_RAD, rng)
    pose = camera.tilted(pose, math.radians(view.yaw_deg), math.radians(view.pitch_deg))
    light, window = background.with_plate(plate.cells, plate.side_m, pose)
    if view.speed_m_s:
        # Light is smeared as a whole: marker and background move alike.
        open_s = camera.exposure_s(view.lux, view.longest_s)
        light = camera.smear(light, FOCAL_PX * view.speed_m_s * open_s / view.range_m)
    return light, window


def picture_cost(
    reader: Reader, background: Background, pictures: int, rng: np.random.Generator, view: View
) -> float:
    """Return the processor time per second of watching [ms], of whole pictures."""
    spent_s = 0.0
    for _ in range(pictures):
        light, window = _marker_before(background, reader, int(rng.integers(IDS)), view, rng)
        whole = background.light.copy()
        whole[window] = light
        picture = camera.expose(whole, view.lux, rng)
        began_s = time.process_time()
        reader.read(picture, camera.CENTRE_PX, view.size_m)
        spent_s += time.process_time() - began_s
    return 1000 * camera.PICTURES_HZ * spent_s / pictures
