# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gives frames of garbage to detectors of any settings, and looks at all that they say.

fuzz.py LIBRARY SEED DETECTORS FRAMES, with the library of the sanitizer loaded before all others.
"""

import sys
from pathlib import Path
from typing import Any

import numpy as np
from cffi import FFI

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from harness_core import KEPT, declarations
from numpy.typing import NDArray

from retrolidar_ros.core import ffi as core_ffi
from retrolidar_ros.detector.likelihood_detector import core_sensor
from retrolidar_ros.marker.code import IDS, PACKET_BITS, packet
from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX

STRANGE = (np.nan, np.inf, -np.inf, 0, -0.0, 1e-40, 3e38, -3e38, 2097152, 2097153, 8.192, -1)
USUAL_STATUS = (5, 5, 5, 5, 6, 9, 10, 255, 8, 0)
EXTREME_NS = (-(2**63), 2**63 - 1, 0, -1, 1 - 2**63, 2**63 - 2)
GARBAGE, LEVEL, PACKET, LONE_PACKET, TWO_PACKETS, PREAMBLES, RANDOM_BITS = range(7)
MOST_AT_ONCE = 64

ffi = FFI()
declared: set[str] = set()
ffi.cdef(declarations('retrolidar_detector_state.h', declared))
ffi.cdef(declarations('retrolidar_tracks.h', declared))
ffi.cdef('void *malloc(size_t); void free(void *);')


def scaled(rng: np.random.Generator, least: float, most: float, count: int | None = None) -> Any:
    """Return numbers of any order of magnitude in between."""
    return least * (most / least) ** rng.random(count)


def settings_of(rng: np.random.Generator) -> dict[str, Any]:
    """Return settings by which little is demanded, so that much is read."""

    def either(usual: float, other: float, share: float = 0.5) -> float:
        return usual if rng.random() < share else other

    side = 4 if rng.random() < 2 / 3 else 8
    slope, ambient = (either(0.22, either(0.0, scaled(rng, 1e-12, 1e12), 0.25)) for _ in range(2))
    sensor = core_sensor(VL53L8CX, ZoneGrid(side, side))
    max_packets = int(rng.integers(1, 9))
    bit_s = either(0.042, scaled(rng, 0.002, 10), 2 / 3)
    sensor.noise_floor = either(4.6, scaled(rng, 1e-12, 1e12))
    sensor.noise_slope, sensor.noise_ambient = slope, ambient
    return {
        'rows': side,
        'columns': side,
        'sensor': bytes(core_ffi.buffer(sensor)),
        'max_packets': max_packets,
        'kept': KEPT,
        'bit_s': bit_s,
        'thresholds': {
            'evidence': either(28.0, 40 * rng.random()),
            'wandering': either(6.0, 0.0),
            'word': either(8.0, 1e3),
            'margin': either(7.0, -1e3),
            'margin_of_more': either(9.0, -1e3),
        },
    }


def garbage(rng: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Return what is no measurement, or any bits."""
    bits = rng.integers(0, 2**32, shape, dtype=np.uint32).view(np.float32)
    sizes = scaled(rng, 1e-6, 1e9, int(np.prod(shape))).reshape(shape).astype(np.float32)
    return np.choose(
        rng.integers(0, 3, shape), [rng.choice(STRANGE, shape).astype(np.float32), sizes, bits]
    )


def stamps_of(rng: np.random.Generator, frames: int, period_ns: int) -> NDArray[np.int64]:
    """Return stamps that stand, jitter, jump, fall back, or are regular, for a while each."""
    stamp, stamps, kind = int(rng.integers(-(2**63), 2**63 - 1)) * (rng.random() < 0.5), [], 5
    for _ in range(frames):
        if rng.random() < 1 / 300:
            kind = int(rng.choice([5, *range(6)]))
        rare = rng.random() < 0.01
        step = (
            int(rng.random() < 0.75),
            int(period_ns * (0.5 + rng.random())),
            period_ns * (1 + int(rng.integers(0, 40)) * (rng.random() < 1 / 30)),
            period_ns if not rare else int(rng.choice(EXTREME_NS)) - stamp,
            -period_ns if rare else period_ns,
            period_ns,
        )[kind if rng.random() < 0.995 else int(rng.integers(0, 6))]
        stamp = (stamp + step + 2**63) % 2**64 - 2**63
        stamps.append(stamp)
    return np.array(stamps, dtype=np.int64)


def light_of(
    rng: np.random.Generator, ids: NDArray[np.uint16], bit_s: float, time_s: Floats
) -> Floats:
    """Return what a zone sees: garbage, or something that blinks like a packet."""
    kind = int(rng.integers(0, 7))
    first, second = (packet(rng.choice(ids) if len(ids) else rng.integers(0, IDS)) for _ in '12')
    if kind == PREAMBLES:
        first = np.arange(PACKET_BITS, dtype=np.uint8) % 2
    elif kind == RANDOM_BITS:
        first = rng.integers(0, 2, PACKET_BITS, dtype=np.uint8)
    cycle = int(rng.integers(40, 100)) if kind == LONE_PACKET else PACKET_BITS
    bright = scaled(rng, 1e-3, 4e6)
    least = bright * rng.random() * rng.integers(0, 2)
    since = (time_s - 62 * bit_s * rng.random()) / (bit_s * rng.choice([1, 1, 0.97, 1.03, 0.5]))

    def is_dark(bits: NDArray[np.uint8], every: int, since: Floats) -> NDArray[np.bool_]:
        level = np.append(bits, np.zeros(every, np.uint8)) > 0
        dark: NDArray[np.bool_] = level[np.floor(since % every).astype(int)]
        return dark

    seen = np.where((kind != LEVEL) & is_dark(first, cycle, since), least, bright)
    if kind == TWO_PACKETS:
        every = int(rng.choice([PACKET_BITS, 50]))
        other = scaled(rng, 0.05, 1) * bright
        seen += np.where(is_dark(second, every, since * 1.003 + 7.3), 0, other)
    if rng.random() < 1 / 3:
        seen *= 0.5 + 0.5 * np.sin(6.3 * time_s / (bit_s * scaled(rng, 10, 1000)))
    noise = bright * scaled(rng, 1e-9, 1) * (rng.random() < 2 / 3)
    seen += noise * (rng.random(len(time_s)) - 0.5)
    return garbage(rng, seen.shape) if kind == GARBAGE else seen


def frames_of(
    rng: np.random.Generator, settings: dict[str, Any], ids: NDArray[np.uint16], count: int
) -> tuple[NDArray[Any], ...]:
    """Return stamps, signal, distance, ambient light and status of frames."""
    # Two frames a bit; or so many that a packet just about fits in what is kept; or any.
    fitting = PACKET_BITS / KEPT * (0.9 + 0.2 * rng.random())
    bits_a_frame = rng.choice([0.5, 0.5, 0.5, fitting, fitting, scaled(rng, 0.02, 2)])
    stamp_ns = stamps_of(rng, count, 1 + int(1e9 * settings['bit_s'] * bits_a_frame))
    steps = np.diff(stamp_ns.astype(np.float64), prepend=stamp_ns[0])
    time_s = np.cumsum(np.where((steps > 0) & (steps < 2**31), steps, 0)) * 1e-9
    zones, alike = settings['rows'] * settings['columns'], rng.random() < 0.5
    light = np.empty((count, zones), np.float32)
    for rows in np.array_split(np.arange(count), rng.integers(1, 4)):
        one = light_of(rng, ids, settings['bit_s'], time_s[rows])
        for zone in range(zones):
            beside = alike and rng.random() < 7 / 8
            light[rows, zone] = (
                one * scaled(rng, 0.1, 1)
                if beside
                else light_of(rng, ids, settings['bit_s'], time_s[rows])
            )
    shape = light.shape
    distance = scaled(rng, 1e-3, 20, zones) * (1 + 0.1 * rng.random(shape))
    ambient, status = np.ones(shape, np.float32), np.full(shape, 5, np.uint8)
    strange = rng.random(shape) < rng.choice([1e-4, 1 / float(rng.integers(1, 100))])
    distance = distance.astype(np.float32)
    for values in (light, distance, ambient):
        values[strange] = garbage(rng, (np.count_nonzero(strange),))
    any_status = rng.integers(0, 256, shape, dtype=np.uint8)
    usual = rng.random(shape) < 0.95
    status[strange] = np.where(usual, rng.choice(USUAL_STATUS, shape), any_status)[strange]
    return stamp_ns, light, distance, ambient, status


def isolate(lib: Any, libc: Any, detector: Any) -> list[Any]:
    """Give each array a block of its own, where a sanitizer sees a sample too many."""
    samples, view, window = detector.samples, detector.search.view, detector.window
    whitened = window.whitened
    capacity, kept = samples.capacity, samples.kept
    lanes = (kept + 1) * lib.RL_MAX_LANES
    blocks = []
    for owner, lengths in (
        (samples, dict.fromkeys(('sum', 'square'), samples.channels)),
        (samples, dict.fromkeys(('begin_s', 'end_s', 'stamp_ns'), capacity)),
        (samples, dict.fromkeys(('signal', 'valid'), capacity * samples.channels)),
        (samples, {'distance': capacity * samples.zones}),
        (view, dict.fromkeys(('light', 'total', 'power', 'valid'), lanes)),
        (view, {'begin': kept + 1, 'rate': kept + 1, 'pivot': (kept + 1) * len(view.room)}),
        *((room, {'signal': kept, 'valid': kept}) for room in [*view.room, window.room]),
        (whitened, dict.fromkeys(('row', 'gain', 'scale', 'signal'), kept)),
        (whitened.interferer, dict.fromkeys(range(len(whitened.interferer)), kept)),
        (window, dict.fromkeys(('light', 'part', 'on_knot'), kept)),
        (detector, {'values': kept, 'role': kept, 'other': lib.RL_MAX_OTHERS * kept}),
        (detector, {'saved': samples.channels * kept}),
    ):
        for name, length in lengths.items():
            array = owner[name] if isinstance(name, int) else getattr(owner, name)
            size = length * ffi.sizeof(ffi.typeof(array).item)
            block = ffi.gc(libc.malloc(size), libc.free)
            ffi.memmove(block, array, size)
            taken = ffi.cast(ffi.typeof(array), block)
            if isinstance(name, int):
                owner[name] = taken
            else:
                setattr(owner, name, taken)
            blocks.append(block)
    return blocks


def check_transmission(sent: Any, settings: dict[str, Any]) -> None:
    """Check what must hold of bits that are judged or read."""
    assert abs(sent.bit_s / settings['bit_s'] - 1) < 0.05
    assert np.isfinite(sent.start_s)


def check(lib: Any, detector: Any, settings: dict[str, Any], ids: NDArray[np.uint16]) -> None:
    """Check what must hold of a detector, whatever it is given."""
    rows, most_packets = settings['rows'], settings['max_packets']
    zones = rows * rows
    sources = sum(side**2 for side in range(rows, rows - 4, -1))  # squares of 1 to 4 zones
    counts, held = lib.rl_detector_counts(detector), detector.samples
    first = lib.rl_samples_oldest(ffi.addressof(detector, 'samples'))
    assert counts.accepted + sum(counts.rejected) == counts.candidates
    assert (held.zones, held.channels) == (zones, sources)
    assert 0 <= first <= held.count <= 4 * KEPT
    assert 0 < held.period_s < np.inf

    def values(array: Any, columns: int, kind: str) -> NDArray[Any]:
        size = columns * held.capacity * np.dtype(kind).itemsize
        all_rows = np.frombuffer(ffi.buffer(array, size), kind).reshape(columns, -1)
        return all_rows[:, first : held.count]

    (begin_s,), (end_s,) = (values(one, 1, 'f8') for one in (held.begin_s, held.end_s))
    assert np.isfinite(begin_s).all()
    assert (begin_s < end_s).all()
    assert (end_s[:-1] <= begin_s[1:]).all()
    signal, distance = values(held.signal, sources, 'f4'), values(held.distance, zones, 'f4')
    assert (np.isfinite(signal) & (signal >= 0)).all()
    assert (np.isnan(distance) | ((distance > 0) & (distance < 8.192))).all()
    newest = lib.rl_detector_newest(detector)
    for one in newest.candidate[0 : newest.candidates]:
        assert 0 <= one.reason <= lib.RL_READ
        assert 0 <= one.channel < sources
        assert 1 <= one.packets <= most_packets
        check_transmission(one.transmission, settings)
        assert np.isfinite([one.evidence, one.margin]).all()
        assert np.isfinite(one.word) or one.word == -np.inf
    for reading in newest.reading[0 : newest.readings]:
        one = reading.verdict
        assert one.id in ids if len(ids) else 0 < one.id < IDS - 1
        assert 1 <= one.packets <= most_packets
        check_transmission(one.transmission, settings)
        assert np.isfinite([one.begin_s, one.end_s, one.evidence, one.margin]).all()
        assert one.begin_s < one.end_s
        assert one.evidence >= settings['thresholds']['evidence']
        assert 1 <= reading.zones <= 16
        assert all(0 <= zone < zones for zone in reading.zone[0 : reading.zones])


def check_places(lib: Any, detector: Any) -> None:
    """Check what must hold of the place of every reading."""
    newest = lib.rl_detector_newest(detector)
    for one in newest.reading[0 : newest.readings]:
        if not one.is_placed:
            continue
        placed = one.placement
        assert 0 < placed.range_m < 20
        assert 0 < placed.range_variance < np.inf
        assert np.isfinite(placed.amplitude)
        assert one.verdict.begin_s - 1 < placed.time_s < one.verdict.end_s + 1
        assert placed.noise > 0
        assert placed.likelihood >= 0
        assert 0 <= placed.score < 1 + 1e-9
        assert 0 <= placed.corrected_bits <= PACKET_BITS
        assert 1 <= placed.zones <= lib.RL_MAX_READ
        assert np.abs(list(placed.bearing.mean)).max() < 0.7 + 1e-9
        assert all(0 <= variance < 0.49 for variance in placed.bearing.variance)


def follow_all(lib: Any, tracks: Any) -> None:
    """Check what must hold of tracks, whatever frames they are followed in."""
    count = lib.rl_tracks_follow(tracks)
    counts = lib.rl_tracks_counts(tracks)
    assert 0 <= count <= lib.RL_MAX_TRACKS
    assert counts.started - counts.ended - counts.dropped == count
    for index in range(count):
        one = lib.rl_tracks_track(tracks, index)
        assert 0 < one.range_m < 100
        assert 0 < one.range_variance < np.inf
        assert np.isfinite([one.range_rate, one.first_s]).all()
        assert 0 < one.range_rate_variance < np.inf
        assert 0 < one.log_odds < np.inf
        assert np.isfinite([*one.tangent]).all()
        assert all(0 <= variance < np.inf for variance in one.tangent_variance)


def try_one(lib: Any, libc: Any, seed: int, count: int) -> str:
    """Give frames to a detector; return what came of them."""
    rng = np.random.default_rng(seed)
    settings = settings_of(rng)
    every = int(rng.integers(1, rng.choice([4, 4095, 4095])))
    ids = np.arange(rng.integers(1, every + 1), IDS - 1, every, dtype=np.uint16)
    other = ('rows', 'columns', 'sensor')
    scalars = {name: value for name, value in settings.items() if name not in other}
    in_c = ffi.new('struct rl_settings *', scalars)
    ffi.memmove(ffi.addressof(in_c, 'sensor'), settings['sensor'], len(settings['sensor']))
    detector = lib.rl_detector_create(in_c, ffi.from_buffer('uint16_t[]', ids), len(ids))
    assert detector
    blocks = isolate(lib, libc, detector)
    tracks = lib.rl_tracks_create(detector)
    assert tracks
    arrays = frames_of(rng, settings, ids, count)
    kinds = ('int64_t', 'float', 'float', 'float', 'uint8_t')
    taken = candidates = read = 0
    while taken < count:
        end = min(taken + int(rng.integers(1, MOST_AT_ONCE + 1)), count)
        while taken < end:
            # Copies, so that a sanitizer sees a frame too many.
            given = [np.copy(values[taken:end]) for values in arrays]
            buffers = [ffi.from_buffer(f'{k}[]', one) for k, one in zip(kinds, given, strict=True)]
            more = lib.rl_detector_push(detector, end - taken, *buffers)
            assert 0 < more <= end - taken
            taken += more
            newest = lib.rl_detector_newest(detector)
            read += newest.readings
            candidates += newest.candidates
            check_places(lib, detector)
            follow_all(lib, tracks)
        check(lib, detector, settings, ids)
    lib.rl_tracks_destroy(tracks)
    lib.rl_detector_destroy(detector)
    del blocks
    zones = settings['rows'] ** 2
    return f'{zones} zones, {len(ids)} IDs: {candidates} candidates, {read} read'


if __name__ == '__main__':
    library, first, detectors, frames = sys.argv[1], *map(int, sys.argv[2:])
    core, c_library = ffi.dlopen(library), ffi.dlopen(None)
    for number in range(first, first + detectors):
        print(f'{number}: {try_one(core, c_library, number, frames)}', flush=True)
