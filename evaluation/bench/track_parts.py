# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the core that follow markers, and what following loses without each in random rooms."""

import math
from typing import Any

import numpy as np

from evaluation.bench.changed_core import Part, lines_of_core
from evaluation.bench.core_trial import FAR_OFF_M, Outcome
from evaluation.bench.places import ELLIPSOID
from evaluation.bench.room_tracks import follow_room

_ROOMS = 200
_MOTIONS = {'STILL': 'rest', 'EVEN': 'even', 'TURNING': 'swing', 'CHANGED': 'turn at once'}

TRACK_PARTS = {
    'clock corrected by edges': Part(
        'followed', '    update_clock(followed, scenery, &glance);', '    (void)update_clock;'
    ),
    'light as predicted only': Part(
        'followed', '        off > fmax(MAX_OFF,', '        0.0 * off > fmax(MAX_OFF,'
    ),
    'another gain after some frames': Part(
        'followed',
        '++followed->off_scale > MAX_OFF_SCALE',
        '++followed->off_scale < 0 * MAX_OFF_SCALE',
    ),
    'zones: the strongest is the last one, or beside it': Part(
        'zone_light', 'rl_zone_beside(zone, near, held->sensor.columns)', 'true'
    ),
    'zones: light near the strongest only': Part(
        'zone_light',
        'rl_zone_beside(zone, strongest, held->sensor.columns);\n}',
        'true;\n}',
    ),
    'zones: light lost and won at an edge': Part(
        'zone_light', 'fabs(all - glance->light) < lost &&', 'false &&'
    ),
    'zones: gains that change as it crosses': Part(
        'zone_light', 'CROSSED_WALK * crossed * most', '0.0 * crossed * most'
    ),
    'zones: gains follow the range': Part(
        'followed', 'pow(to_m / from_m, RL_EXPONENT)', 'pow(to_m / from_m, 0.0)'
    ),
    'zones: a gain begins anew': Part(
        'zone_light', 'if (surprise > MAX_SURPRISE &&', 'if (false && surprise > MAX_SURPRISE &&'
    ),
    'zones: excess variance': Part(
        'zone_light', 'one->excess += EXCESS_SHARE', 'one->excess += 0.0 * EXCESS_SHARE'
    ),
    'zones: doubt after the packet': Part(
        'tracks_begin', '    rl_zone_doubt(followed->zone, samples->zones, reading);', '    ;'
    ),
    'a reading of one that is lost begins anew': Part(
        'tracks', 'if (rl_followed_lost(before) < 1.0) {', 'if (true) {'
    ),
    'the packet replayed': Part(
        'tracks_begin',
        'row < window->rows; row++) {\n        see(',
        'row < 0; row++) {\n        see(',
    ),
    'others beside fitted anew': Part(
        'tracks_begin',
        'if (is_beside(tracks, &tracks->track[i], zone)) {',
        'if (false && is_beside(tracks, &tracks->track[i], zone)) {',
    ),
    'light of others beside, in the packet': Part(
        'tracks_begin', 'if (other != own && is_beside(', 'if (false && is_beside('
    ),
    'presence: hidden': Part('presence', 'HIDES = 0.1', 'HIDES = 0.0'),
    'presence: beside another marker': Part('presence', 'GAINS = 0.6', 'GAINS = 0.0'),
    'presence: another ID': Part('presence', 'CHANGES = 0.03', 'CHANGES = 0.0'),
    'presence: dark bits count less': Part('presence', 'DARK_PART = 0.6', 'DARK_PART = 1.0'),
    'presence: evidence summed': Part(
        'presence', 'presence->seen_nats < SEEN', 'presence->seen_nats < 0.0 * SEEN'
    ),
    'a nearer target hides it': Part('followed_range', 'sample.valid = false;', ';'),
    'range: background': Part('followed_range', 'mixed = share * chance;', 'mixed = 0.0 * chance;'),
    'range: or a mounting': Part(
        'followed_range',
        '*chance = rl_chance_apart(squared, spread, separable_m);',
        '*chance = 1.0 + 0.0 * rl_chance_apart(squared, spread, separable_m);',
    ),
    'range: it may turn while it is dark': Part(
        'followed_range', 'MAX_CHANGE = 1.2', 'MAX_CHANGE = 0.0'
    ),
    'range: a background that moves with it': Part(
        'followed', 'exp(-step_s * rate / BACKGROUND_M)', 'exp(-0.0 * rate / BACKGROUND_M)'
    ),
    'range: error of the background': Part(
        'followed_range', '(share * share * offset_variance +', '(0.0 * offset_variance +'
    ),
    'range: error of unknown light': Part('followed_range', 'UNKNOWN_M = 0.4', 'UNKNOWN_M = 0.0'),
    'range: gate': Part('followed_range', 'GATE = 25.0', 'GATE = 1e30'),
    'range: noise learnt': Part('followed_range', 'LESSON = 0.02', 'LESSON = 0.0'),
    'range: error by other markers lasts': Part(
        'followed_range', 'offset_variance + lasting -', 'offset_variance -'
    ),
    'range: other markers subtracted': Part(
        'followed_range', 'if (other <= 0.0) {', 'if (other < INFINITY) {'
    ),
    **{
        f'motion: {words}': Part(
            'range_filter',
            'nats[i] = log(filter->chance[i]) -',
            f'nats[i] = (i == {name} ? -1e3 : 0.0) + log(filter->chance[i]) -',
        )
        for name, words in _MOTIONS.items()
    },
    'bearing: it may move while it is dark': Part('tracks', 'moved = moves', 'moved = 0.0 * moves'),
    'bearing: one that is lost may have moved': Part(
        'tracks', 'fmax(followed->crossed, rl_followed_lost(followed))', 'followed->crossed'
    ),
}
"""By what they do."""


def track_changes() -> dict[str, list[Part]]:
    """Return what changes the core without each part."""
    return {name: [part] for name, part in TRACK_PARTS.items()}


def measure(seed: int, times: float) -> dict[str, Any]:
    """Return outcomes by room, `times` the usual number of rooms, and lines of the core."""
    rooms = [follow_room(number, seed) for number in range(math.ceil(_ROOMS * times))]
    off = [[at for marker in one.markers for at in marker.off] for one in rooms]
    off_zones = [[at for marker in one.markers for at in marker.off_zones] for one in rooms]
    frames = [sum(marker.frames for marker in one.markers) for one in rooms]
    return {
        'followed': [Outcome(len(own), of, 0) for own, of in zip(off, frames, strict=True)],
        'range': [_mean([min(abs(at.range_m), FAR_OFF_M) for at in own]) for own in off],
        'bearing': [_mean(own) for own in off_zones],
        'ellipsoid': [_mean([at.squared_distance > ELLIPSOID for at in own]) for own in off],
        'false': [Outcome(0, 0, one.false) for one in rooms],
        'lines': lines_of_core(),
    }


def _mean(values: list[float]) -> Outcome:
    return Outcome(-float(np.mean(values or 0.0)), 1, 0)
