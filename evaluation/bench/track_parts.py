# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the core that follow markers, and what following loses without each in random rooms."""

import math
from typing import Any

import numpy as np

from evaluation.bench.changed_core import Part, lines_of_core, parts_of
from evaluation.bench.core_trial import FAR_OFF_M, Outcome
from evaluation.bench.places import ELLIPSOID
from evaluation.bench.room_tracks import follow_room

_ROOMS = 200
_MOTIONS = {'STILL': 'rest', 'EVEN': 'even', 'TURNING': 'swing', 'CHANGED': 'turn at once'}

_LINES = {
    'clock corrected by edges': 'followed: '
    '{update_clock(followed, scenery, &glance) => (void)update_clock};',
    'light as predicted only': 'followed: {off => 0.0 * off} > fmax(MAX_OFF,',
    'another gain after some frames': 'followed: ++followed->off_scale {> => < 0 *} MAX_OFF_SCALE',
    'zones: the strongest is the last one, or beside it': 'zone_light: '
    '{rl_zone_beside(zone, near, held->sensor.columns) => true}',
    'zones: light near the strongest only': 'zone_light: '
    '{rl_zone_beside(zone, strongest, held->sensor.columns) => true};\n}',
    'zones: light lost and won at an edge': 'zone_light: '
    '{fabs(all - glance->light) < lost => false} &&',
    'zones: gains that change as it crosses': 'zone_light: {CROSSED_WALK => 0.0} * crossed * most',
    'zones: gains follow the range': 'followed: pow(to_m / from_m, {RL_EXPONENT => 0.0})',
    'zones: a gain begins anew': 'zone_light: '
    'if ({surprise => false && surprise} > MAX_SURPRISE &&',
    'zones: excess variance': 'zone_light: one->excess += {EXCESS_SHARE => 0.0 * EXCESS_SHARE}',
    'zones: doubt after the packet': 'tracks_begin: '
    '{rl_zone_doubt(followed->zone, samples->zones, reading); => ;}',
    'a reading of one that is lost begins anew': 'tracks: '
    'if ({rl_followed_lost(before) < 1.0 => true}) {',
    'the packet replayed': 'tracks_begin: row < {window->rows => 0}; row++) {\n        see(',
    'others beside fitted anew': 'tracks_begin: '
    'if ({is_beside => false && is_beside}(tracks, &tracks->track[i], zone)) {',
    'light of others beside, in the packet': 'tracks_begin: '
    'if ({other != own => false} && is_beside(',
    'presence: hidden': 'presence: HIDES = {0.1 => 0.0}',
    'presence: beside another marker': 'presence: GAINS = {0.6 => 0.0}',
    'presence: another ID': 'presence: CHANGES = {0.03 => 0.0}',
    'presence: dark bits count less': 'presence: DARK_PART = {0.6 => 1.0}',
    'presence: evidence summed': 'presence: presence->seen_nats < {SEEN => 0.0 * SEEN}',
    'a nearer target hides it': 'followed_range: {sample.valid = false; => ;}',
    'range: background': 'followed_range: mixed = {share => 0.0} * chance;',
    'range: or a mounting': 'followed_range: '
    '*chance = {rl_chance_apart => 1.0 + 0.0 * rl_chance_apart}(squared, spread, separable_m);',
    'range: it may turn while it is dark': 'followed_range: MAX_CHANGE = {1.2 => 0.0}',
    'range: a background that moves with it': 'followed: '
    'exp(-{step_s => 0.0} * rate / BACKGROUND_M)',
    'range: error of the background': 'followed_range: ({share * share => 0.0} * offset_variance +',
    'range: error of unknown light': 'followed_range: UNKNOWN_M = {0.4 => 0.0}',
    'range: gate': 'followed_range: GATE = {25.0 => 1e30}',
    'range: noise learnt': 'followed_range: LESSON = {0.02 => 0.0}',
    'range: error by other markers lasts': 'followed_range: offset_variance {+ lasting - => -}',
    'range: other markers subtracted': 'followed_range: if (other {<= 0.0 => < INFINITY}) {',
    **{
        f'motion: {words}': 'range_filter: '
        f'nats[i] = {{log => (i == {name} ? -1e3 : 0.0) + log}}(filter->chance[i]) -'
        for name, words in _MOTIONS.items()
    },
    'bearing: it may move while it is dark': 'tracks: moved = {moves => 0.0 * moves}',
    'bearing: one that is lost may have moved': 'tracks: '
    '{fmax(followed->crossed, rl_followed_lost(followed)) => followed->crossed}',
}
TRACK_PARTS = parts_of(_LINES)
"""By what they do."""


def track_changes() -> dict[str, list[Part]]:
    """Return what changes the core without each part."""
    return {name: [one] for name, one in TRACK_PARTS.items()}


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
