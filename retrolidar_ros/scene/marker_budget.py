# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What to expect of a marker before it is built: its link, its waking and its battery."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.battery import Drawn, active_share, drawn, life_h
from retrolidar_ros.marker.wakeup import THRESHOLD_V, voltage_v, wakeup_range_m
from retrolidar_ros.scene.description import Noise
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, received_signal
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.settings.section import ConfigError, quantity

SNR = 'c/\N{GREEK SMALL LETTER SIGMA}'
NEEDED_SNR_DB = 8.4
"""c over sigma at which the default method reads 80 % of lone packets."""
SENSOR_REACH_M = 4.0
"""To what distance a VL53L8CX measures."""


@dataclass(frozen=True)
class Case:
    """A marker and how it is used."""

    size_m: float
    yaw_rad: float
    distance_m: float
    cell_mah: float
    queries_per_hour: float


class Link(NamedTuple):
    """Signals [kcps/SPAD] before the wall of the reference scene, and what is read of them."""

    bright: float
    dark: float
    noise: float
    """Standard deviation at the mean of both."""
    snr_db: float
    """c over sigma; minus infinity if nothing comes back."""
    reach_m: float
    """To what distance 80 % of lone packets are read at this size and yaw."""


class WakeUp(NamedTuple):
    """The photodiode indoors, with the paper's threshold."""

    voltage_v: float
    threshold_v: float
    woken: bool
    range_m: float
    """To what distance it wakes at this yaw."""


class Battery(NamedTuple):
    """Mean currents [mA] with a packet a query, and how long the cell lasts."""

    drawn_ma: Drawn
    life_h: float


class Budget(NamedTuple):
    """All of it."""

    case: Case
    link: Link
    wake_up: WakeUp
    battery: Battery


def parse_case(size: str, yaw: str, distance: str, cell: str, queries: str) -> Case:
    """Return the case of the command's options, units as in scene files.

    A marker may be as large as a zone is at its distance.

    Raises
    ------
    ConfigError
        If one cannot be; the message names the option and its value.
    """
    distance_m = quantity('length', 0.1, SENSOR_REACH_M)(distance, '--distance')
    zone_m = distance_m * float((SENSOR.grid.pitch * SENSOR.grid.z_per_range).min())
    return Case(
        size_m=quantity('length', 1e-3, zone_m)(size, '--size'),
        yaw_rad=quantity('angle', -math.pi / 2, math.pi / 2)(yaw, '--yaw'),
        distance_m=distance_m,
        cell_mah=quantity('charge', 1.0)(cell, '--cell'),
        queries_per_hour=_rate(queries, '--queries'),
    )


def _rate(text: str, path: str) -> float:
    """Parse how many packets a marker is asked for in an hour."""
    try:
        value = float(text)
    except ValueError:
        raise ConfigError(f'{path}: {text!r} is not a number') from None
    try:
        active_share(value)
    except ValueError as error:
        raise ConfigError(f'{path}: {error}') from None
    return value


def budget(case: Case) -> Budget:
    """Compute the budget of a case."""
    currents = drawn(active_share(case.queries_per_hour))
    voltage = float(voltage_v(np.array(case.distance_m), case.yaw_rad))
    return Budget(
        case=case,
        link=_link(case),
        wake_up=WakeUp(
            voltage_v=voltage,
            threshold_v=THRESHOLD_V,
            woken=voltage >= THRESHOLD_V,
            range_m=wakeup_range_m(angle_rad=case.yaw_rad),
        ),
        battery=Battery(currents, life_h(case.cell_mah, currents.total)),
    )


def needed_swing(
    snr_db: float, noise: Noise | NoiseLaw = NOISE, wall: float = WALL_SIGNAL
) -> float:
    """Return the signal [kcps/SPAD] between bright and dark that gives a c over sigma [dB].

    The noise is taken at the wall and half of c, so c solves c² = r²·(floor + slope·(wall + c/2))
    with r the wanted ratio.
    """
    power = 10 ** (snr_db / 10)
    linear = noise.slope * power / 4
    silent = noise.floor + noise.slope * wall
    return linear + math.sqrt(linear * linear + power * silent)


def _link(case: Case) -> Link:
    at_1_m, swing = (
        float(received_signal(np.array(range_m), case.size_m**2, case.yaw_rad))
        for range_m in (1.0, case.distance_m)
    )
    noise = math.sqrt(NOISE.floor + NOISE.slope * (WALL_SIGNAL + swing / 2))
    reach_m = (needed_swing(NEEDED_SNR_DB) / at_1_m) ** (1 / DISTANCE_EXPONENT) if at_1_m else 0.0
    return Link(
        bright=WALL_SIGNAL + swing,
        dark=WALL_SIGNAL,
        noise=noise,
        snr_db=20 * math.log10(swing / noise) if swing else -math.inf,
        reach_m=min(reach_m, SENSOR_REACH_M),
    )


def to_json(found: Budget) -> dict[str, Any]:
    """Return a budget fit for JSON; null stands for a link without any signal."""
    link = found.link._asdict()
    if not math.isfinite(found.link.snr_db):
        link['snr_db'] = None
    return {
        **asdict(found.case),
        'link': link,
        'wake_up': found.wake_up._asdict(),
        'battery': {
            'drawn_ma': found.battery.drawn_ma._asdict(),
            'total_ma': found.battery.drawn_ma.total,
            'life_h': found.battery.life_h,
        },
    }


def to_text(found: Budget) -> str:
    """Return a budget as lines for the terminal."""
    case, link, wake_up, battery = found
    ratio = f'{link.snr_db:.1f} dB' if math.isfinite(link.snr_db) else 'nothing comes back'
    reach = f'up to {wake_up.range_m:.2f} m' if wake_up.range_m else 'at no distance'
    drawn_ua = ', '.join(
        f'{name} {1e3 * part:.1f}' for name, part in battery.drawn_ma._asdict().items()
    )
    awake = 'wakes' if wake_up.woken else 'stays asleep'
    rows = (
        ('marker', f'{100 * case.size_m:g} cm at {case.distance_m:g} m'),
        ('', f'yaw {math.degrees(case.yaw_rad):g}°'),
        ('link', f'bright {link.bright:.1f}, dark {link.dark:.1f} kcps/SPAD'),
        ('', f'noise {link.noise:.1f} kcps/SPAD, {SNR} {ratio}'),
        ('', f'80 % of lone packets are read to {link.reach_m:.2f} m'),
        ('wake-up', f'{1e3 * wake_up.voltage_v:.1f} mV indoors'),
        ('', f'threshold {1e3 * wake_up.threshold_v:.1f} mV: it {awake}'),
        ('', f'at this yaw it wakes {reach}'),
        ('battery', f'{drawn_ua}, together {1e3 * battery.drawn_ma.total:.1f} µA'),
        ('', f'queries an hour: {case.queries_per_hour:g}, a packet each'),
        ('', f'{case.cell_mah:g} mAh last {battery.life_h:.0f} h, {battery.life_h / 24:.1f} days'),
    )
    return '\n'.join(f'{subject:8}{value}' for subject, value in rows)
