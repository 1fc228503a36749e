# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a track ends: after how many bits unseen a marker counts as gone."""

import textwrap
from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.changed_core import Part, call_with
from evaluation.bench.following import play
from evaluation.bench.recordings import Sent, record, record_at
from evaluation.bench.stresses import PLAIN, Stress
from evaluation.experiments.moving import WAYS
from evaluation.report.chart_style import OTHERS, SHADES, label, legend_under, line, new_chart
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording

TITLE = 'When tracks end'
_USED_BITS = 12.0  # by the core
_RANGES_M = (1.0, 2.0)
_GONE_BITS = (8.5, _USED_BITS, 17.0)
_TRIALS, _DURATION_S = 24, 30.0
_KNOWN_S = 3.0  # markers repeat so long before something happens
_AFTER_S = 2.5
_LINE = 'GONE_BITS = {:.1f}'


def _sent(
    range_m: float,
    duration_s: float,
    rng: np.random.Generator,
    stress: Stress = PLAIN,
    way: str = 'to and fro',
    speed_m_s: float = 0.0,
) -> Sent:
    path = WAYS[way](speed_m_s, range_m, rng)
    return record_at(range_m, rng, stress, path=path, repeated_s=duration_s)


def _spliced(before: Recording, after: Recording, frame: int) -> Recording:
    """Return one recording up to a frame, and another one from there on."""
    arrays = {
        name: np.concatenate([values[:frame], getattr(after, name)[frame:]])
        for name, values in vars(before).items()
        if name != 'grid'
    }
    return replace(before, **arrays)


def _all_bright(recording: Recording, rng: np.random.Generator) -> Recording:
    """Return as many frames, drawn from those in which the marker is bright."""
    signal = recording.signal[:, recording.signal.std(axis=0).argmax()]
    dark, bright = np.quantile(signal, (0.1, 0.9))
    kept = np.flatnonzero(signal > dark + 0.9 * (bright - dark))
    rows = rng.choice(kept, len(signal))
    seen = {name: getattr(recording, name)[rows] for name in ('signal', 'distance', 'status')}
    return replace(recording, **seen)


ENDS = ('vanished', 'other ID', 'stays bright')


def dropped_s(range_m: float, rng: np.random.Generator, *, end: str) -> float | None:
    """Return how long a marker is followed after one of the `ENDS` [s].

    None if it was not followed.
    """
    duration_s = _KNOWN_S + _AFTER_S
    sent = _sent(range_m, duration_s, rng)
    if end == 'other ID':
        after = _sent(range_m, duration_s, rng).recording
    elif end == 'stays bright':
        after = _all_bright(sent.recording, rng)
    else:
        after = record(PLAIN, 1e-6, rng, range_m=range_m, repeated_s=duration_s).recording
    frame = round((_KNOWN_S + 1.3 * rng.random()) / SENSOR.period_s)
    _, steps = play(_spliced(sent.recording, after, frame))
    known = [any(one.id == sent.ids[0] for one in step.tracks) for step in steps]
    if not known[frame - 1]:
        return None
    last = next((index for index in range(frame, len(known)) if not known[index]), len(known))
    return (last - frame) * SENSOR.period_s


_STRESSES: dict[str, dict[str, Any]] = {
    'still': {},
    'to and fro, 0.6 m/s': {'speed_m_s': 0.6},
    'across, 0.3 m/s': {'way': 'across the view', 'speed_m_s': 0.3},
    'across, 0.6 m/s': {'way': 'across the view', 'speed_m_s': 0.6},
    'hand, 0.1 s a packet': {'stress': Stress('hand', hand_s=0.1)},
    '10 % lost': {'stress': Stress('lost', lost=0.1)},
}
SCENES = tuple(_STRESSES)


def false_ends(scene: str, duration_s: float, rng: np.random.Generator) -> int:
    """Return how often the track of a marker ends though the marker stays."""
    sent = _sent(rng.uniform(1.0, 2.0), duration_s, rng, **_STRESSES[scene])
    return play(sent.recording)[0].counts.tracks_ended


def measure(gone_bits: float, seed: int, trials: int, duration_s: float) -> dict[str, Any]:
    """Return how tracks end by the imported core, in which `gone_bits` is set."""
    rng = np.random.default_rng(seed)
    ends: dict[str, list[list[float]]] = {}
    for name in ENDS:
        drops = [[dropped_s(at, rng, end=name) for _ in range(trials)] for at in _RANGES_M]
        times_s = [[one for one in own if one is not None] for own in drops]
        ends[name] = [np.percentile(one, [50, 95]).tolist() if one else [] for one in times_s]
    hours = trials * duration_s / 3600
    return {
        'gone_bits': gone_bits,
        'ends': ends,
        'false_ends_an_hour': {
            scene: sum(false_ends(scene, duration_s, rng) for _ in range(trials)) / hours
            for scene in SCENES
        },
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how tracks end, by the bits after which a marker counts as gone."""
    settings = (int(rng.integers(2**32)), *((2, 5.0) if quick else (_TRIALS, _DURATION_S)))
    rows = []
    for bits in _GONE_BITS:
        change = Part('presence', _LINE.format(_USED_BITS), _LINE.format(bits))
        rows.append(call_with([change], measure, bits, *settings))
    return {'ranges_m': _RANGES_M, 'rows': rows}


def draw(figures: dict[str, Any]) -> Any:
    """Draw the time until tracks end, and how often they end falsely, over the bits unseen."""
    rows = figures['rows']
    used = next(one['ends'] for one in rows if one['gone_bits'] == _USED_BITS)
    vanished, bright = (max(one[-1] for one in used[end]) for end in ('vanished', 'stays bright'))
    title = (
        f'95 of 100 markers that vanish are dropped within {vanished:.2f} s, '
        f'that stay bright within {bright:.2f} s'
    )
    bits = [one['gone_bits'] for one in rows]
    figure, (times, ends) = new_chart(2, 2, 4.2, title)
    for colour, name in zip(OTHERS, ENDS, strict=False):
        times.plot([], [], color=colour, label=name)
        for index, style in enumerate('-:'):
            worst = [one['ends'][name][index][-1] for one in rows]
            times.plot(bits, worst, color=colour, linestyle=style, marker='o')
    for range_m, style in zip(_RANGES_M, '-:', strict=True):
        times.plot([], [], **line(style), label=f'at {range_m:g} m')
    hourly = {scene: [one['false_ends_an_hour'][scene] for one in rows] for scene in SCENES}
    often, never = ([s for s in hourly if any(hourly[s]) == has] for has in (True, False))
    for colour, sign, scene in zip(SHADES, 'osDv^', often, strict=False):
        ends.plot(bits, hourly[scene], color=colour, marker=sign, label=scene)
    x, title = 'gone after bits unseen', textwrap.fill(f'never if {"; or ".join(never)}', 40)
    label(times, x, '95 % are dropped after [s]')
    most = max(max(one) for one in hourly.values())
    label(ends, x, 'false ends [1/h]', title if never else '', ylim=(0, 1.3 * most + 1))
    for axis in (times, ends):
        axis.axvline(_USED_BITS, color='0.7', linewidth=1)
        axis.text(_USED_BITS + 0.1, 0.15, 'as shipped', transform=axis.get_xaxis_transform())
        legend_under(axis, 2)
    return figure
