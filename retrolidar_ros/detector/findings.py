# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why markers are not read: causes, and one sentence for each."""

from collections.abc import Sequence
from enum import Enum
from typing import Any

_DARKER = 'check polarisers and voltage, or go farther away if so much light saturates the sensor'
_MAX_LISTED = 4


class Cause(Enum):
    """A cause; its value is the template of the sentence with the remedy."""

    FEW_FRAMES = 'too few frames, {frames}: a packet takes {packet_s:.1f} s'
    STAMPS = 'the stamps of the frames stand still: record again with a clock that runs'
    FRAME_RATE = (
        'a frame comes every {frame_ms:.1f} ms, but bit_period is {bit_ms:.1f} ms: {frames:.1f} '
        'frames, and not one to eight. Let the markers hold a bit for two frames (bit_period '
        '{two_s:.3f}), or let the sensor measure at another rate'
    )
    SHORT_BITS = (
        'bits of {bit_ms:.1f} ms last {frames:.1f} frames: two are read farther. Let the sensor '
        'measure faster, or the markers hold bits longer'
    )
    BIT_PERIOD = (
        'zone {zone} blinks by {blinks_db:.0f} dB; ID {ids} is read with bits of {found_ms:.1f} '
        'ms, not of {bit_ms:.1f} ms: set bit_period to {found_s:.4f}'
    )
    MAX_PACKETS = 'ID {ids} is read with max_packets 8: it is faint, and max_packets is {packets}'
    UNREGISTERED = 'ID {ids} would be read if registered_ids held it'
    FEW_READ = (
        'ID {ids} was read in {read} packets of {sent}: it is faint, hidden at times, or noisier '
        'than set'
    )
    WITHHELD = '{withheld} readings are withheld: fewer agree than min_readings, {required}'
    NO_BLINKING = (
        'no zone blinks: let a marker repeat its packet within the view, a metre away at most; '
        'it may be asleep: wake it with light'
    )
    STEADY = (
        'zone {zone} is by far the brightest, and steady. If that is a marker, wake it with light; '
        f'{_DARKER}'
    )
    LOW_CONTRAST = (
        'zone {zone} blinks by {blinks_db:.0f} dB, but by {percent:.0f} % of its light only: '
        f'{_DARKER}'
    )
    NO_CLOCK = (
        'zone {zone} blinks by {blinks_db:.0f} dB without a bit clock: something moves, or the '
        'light flickers'
    )
    NO_ID = (
        'zone {zone} blinks by {blinks_db:.0f} dB, but no ID fits (tried bits of {tried} ms). '
        'Several markers in the zone? Set registered_ids. Too faint? Go nearer. Else check the code'
    )
    NOISE = (
        'noise is {scale:.2g} times the configured value: run `retrolidar calibrate BAG` for '
        'noise_floor, noise_slope and noise_ambient'
    )
    NO_NOISE = (
        'the recording has no noise, so nothing can be told of it: give the scene `noise`, as the '
        'sensor has'
    )
    GLASS = (
        'zone {zones} sees something nearer than {nearer_cm:.0f} cm, such as a cover glass: it '
        'hides what is fainter; take it off or clean it'
    )
    INVALID = (
        'most samples of zone {zones} are invalid, mostly status {status}: shade it from the sun, '
        'clean the window, and let something be within reach'
    )
    FLICKER = (
        'the ambient light flickers from frame to frame: another sensor shines into the view, or a '
        'lamp; turn one of them away'
    )


class Finding:
    """A cause, and the values in its sentence."""

    def __init__(self, cause: Cause, **values: Any) -> None:
        self.cause, self.values = cause, values

    def __str__(self) -> str:
        """Return the sentence."""
        return self.cause.value.format(**self.values)


def listed(values: Sequence[object]) -> str:
    """Return values for a sentence: the first few, and how many more there are."""
    text = ', '.join(map(str, values[:_MAX_LISTED]))
    more = len(values) - _MAX_LISTED
    return f'{text} and {more} more' if more > 0 else text
