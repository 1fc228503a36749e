# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The picture that `plot` and the demo draw, by what its parts are."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip('matplotlib', reason='needs matplotlib, which is a pip extra')

from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from retrolidar_ros.cli.plot import plot_readings
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Sensor, Surface, Waypoint
from retrolidar_ros.sensor.frame import Recording

SENSOR = Sensor(noise=Noise(4.6, 0.22))


def seen(*markers: Marker) -> Recording:
    walls = (Surface(2.5, 4.0),)
    return Simulation(Scene(sensor=SENSOR, markers=markers, surfaces=walls)).run(6.0)


def drawn(recording: Recording, monkeypatch: pytest.MonkeyPatch, *markers: Marker) -> Any:
    figures: list[Any] = []
    monkeypatch.setattr(Figure, 'savefig', lambda figure, *_, **__: figures.append(figure))
    readings = list(Decoding(defaults()).detect(recording))
    plot_readings(recording, readings, Path('unused.png'), title='t', hint='h', markers=markers)
    return figures[0]


def test_two_ids_in_a_zone_have_two_colours(monkeypatch: pytest.MonkeyPatch) -> None:
    near = Marker(id=2816, position_m=(0.1, 0.1, 1.0))
    far = Marker(id=204, position_m=(0.16, 0.16, 1.6), start_s=0.3)
    figure = drawn(seen(near, far), monkeypatch)
    panels = [axes for axes in figure.axes if 'zone 10' in axes.get_title(loc='left')]
    assert len(panels) == 2
    assert len({to_hex(axes.lines[0].get_color()) for axes in panels}) == 2
    assert figure._suptitle.get_text() == 't\nh'


def test_bits_before_the_recording_are_marked(monkeypatch: pytest.MonkeyPatch) -> None:
    marker = Marker(id=2816, position_m=(0.1, 0.1, 1.0))
    late = Recording.of(list(seen(marker))[20:])
    figure = drawn(late, monkeypatch)
    (panel,) = (axes for axes in figure.axes if 'ID 2816' in axes.get_title(loc='left'))
    assert panel.get_xlim()[0] < 0
    digits = [one for one in panel.texts if one.get_text() in '01']
    unseen = [one for one in digits if one.get_position()[0] < -0.042]
    assert len(digits) > 31  # as many as were used, from the packet's first bit on
    assert unseen
    assert {one.get_color() for one in unseen} == {'0.5'}


def test_what_moves_is_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    path = (Waypoint(0.0, (-0.2, 0.1, 1.0)), Waypoint(6.0, (0.2, 0.1, 1.0)))
    marker = Marker(id=2816, path=path)
    here = drawn(seen(marker), monkeypatch, marker).axes[0]
    across = [np.ptp(line.get_xdata()) for line in here.lines]
    assert max(across) == pytest.approx(0.4, abs=0.02)
    assert 'lines: motion' in here.get_title()
