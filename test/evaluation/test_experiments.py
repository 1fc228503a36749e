# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every experiment runs; rates, intervals, verdicts, and the committed report against the code."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

from evaluation.__main__ import main
from evaluation.bench.rates import crossing, frequency, rate
from evaluation.bench.stresses import PANELS
from evaluation.experiments import peers
from evaluation.experiments.paper_sweeps import SWEEPS
from evaluation.experiments.registry import EXPERIMENTS, run_experiment
from evaluation.report.readme import ALL, PAGE, load, renewed, write_page
from evaluation.report.verdicts import (
    Said,
    above,
    below,
    exactly,
    judge,
)


@pytest.mark.parametrize(
    ('hits', 'low', 'high'),
    # Wilson intervals as R's prop.test(x, 10, correct = FALSE) gives them.
    [(0, 0.0, 0.2775), (5, 0.2366, 0.7634), (10, 0.7225, 1.0)],
)
def test_wilson_intervals_of_ten_trials(hits: int, low: float, high: float) -> None:
    measured = rate(hits, 10)
    assert measured['rate'] == hits / 10
    assert (measured['low'], measured['high']) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(
    ('events', 'low', 'high'),
    # Exact intervals of a Poisson count (Garwood 1936).
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (10, 4.7954, 18.3904), (100, 81.364, 121.627)],
)
def test_poisson_intervals(events: int, low: float, high: float) -> None:
    measured = frequency(events, 2.0)
    assert measured['per_hour'] == events / 2
    assert (measured['low'], measured['high']) == pytest.approx((low / 2, high / 2), abs=1e-3)


def test_a_crossing_has_bounds_that_shrink_with_trials() -> None:
    few, many = (
        crossing(0.8, [1, 2, 3], [rate(n, n), rate(n * 9 // 10, n), rate(n // 10, n)])
        for n in (20, 2000)
    )
    for found in (few, many):
        assert found['low'] is not None
        assert found['high'] is not None
        assert found['low'] <= 2.125 <= found['high']
        assert found['at'] == pytest.approx(2.125, abs=0.01)
    assert crossing(0.8, [1, 2], [rate(9, 10), rate(9, 10)])['at'] == 2
    assert crossing(0.8, [1, 2], [rate(1, 10), rate(0, 10)])['at'] is None
    assert many['high'] - many['low'] < few['high'] - few['low']  # type: ignore[operator]


@pytest.mark.parametrize(
    ('value', 'said', 'judged'),
    [
        (2.72, exactly(2.6, 'better'), 'same'),
        (2.88, exactly(2.6, 'better'), 'better'),
        (2.4, exactly(2.6, 'better'), 'worse'),
        (0.5, exactly(1, 'worse'), 'better'),
        (0.27, exactly(0.32), 'differs'),
        (-53, exactly(-85, 'worse'), 'worse'),
        (-87, exactly(-85, 'worse'), 'same'),
        (0.2, below(4), 'same'),
        (4.4, below(2), 'worse'),
        (1.76, above(1), 'same'),
    ],
)
def test_a_value_beside_the_papers(value: float, said: Said, judged: str) -> None:
    assert judge(value, said) == judged


ROOT = Path(__file__).parents[2]
COMMITTED = ROOT / 'docs' / 'report'
PAGES = sorted((ROOT / 'evaluation' / 'report' / 'pages').glob('*.md'))
DOCUMENTS = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]


def test_every_experiment_has_its_chart_in_the_report() -> None:
    chapters = ''.join(path.read_text(encoding='utf-8') for path in PAGES)
    for name, experiment in EXPERIMENTS.items():
        assert (f'{{{{chart {name}}}}}' in chapters) == hasattr(experiment, 'draw'), name


def test_the_committed_run_is_whole_and_says_of_what() -> None:
    report = load(COMMITTED)
    assert report.keys() == EXPERIMENTS.keys()
    for name, figures in report.items():
        assert figures['run']['quick'] is False, name
        assert (COMMITTED / f'{name}.png').exists() == hasattr(EXPERIMENTS[name], 'draw')
    page = (COMMITTED / PAGE).read_text(encoding='utf-8')
    run = report['ranging']['run']
    for said in (run['processor'], run['python'], run['versions']['numpy'], str(run['seed'])):
        assert said in page


def test_the_page_is_that_of_its_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(name: str, figures: dict[str, Any], _: Path) -> None:
        if hasattr(EXPERIMENTS[name], 'draw'):
            plt.close(EXPERIMENTS[name].draw(figures))  # to write it takes long

    monkeypatch.setattr('evaluation.report.readme.save_chart', draw)
    for path in COMMITTED.glob('*.json'):
        shutil.copy(path, tmp_path)
    page = write_page(tmp_path).read_text(encoding='utf-8')
    assert page == (COMMITTED / PAGE).read_text(encoding='utf-8')
    assert len(page.replace('|', ' ').split()) <= 4700


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda path: path.name)
def test_the_figures_of_a_document_are_those_of_the_report(document: Path) -> None:
    text = document.read_text(encoding='utf-8')
    assert renewed(text, load(COMMITTED, ALL)) == text


def test_a_quick_look_does_not_overwrite_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['marker', '--quick']) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ['report_quick']
    assert (tmp_path / 'report_quick' / 'marker.png').exists()
    assert capsys.readouterr().out.endswith('report_quick\n')


def test_several_experiments_at_once_are_the_same_as_one_by_one(tmp_path: Path) -> None:
    together, alone = tmp_path / 'together', tmp_path / 'alone'
    alone.mkdir()
    options = ['chain', 'marker', '--quick', '-o', str(together)]
    command = [sys.executable, '-m', 'evaluation', *options]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert done.stdout.count('chain: One packet') == 1
    assert sorted(path.name for path in together.glob('*.json')) == ['chain.json', 'marker.json']
    for name in ('chain', 'marker'):
        run_experiment(name, alone, quick=True, seed=1)
        one, other = (json.loads((at / f'{name}.json').read_text()) for at in (together, alone))
        del one['run'], other['run']
        assert one == other


def test_an_unknown_experiment_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['nothing']) == 2
    assert "unknown experiment 'nothing'; there is speed-accuracy" in capsys.readouterr().err


# So small that all run in seconds, by the module that has a size.
TINY: dict[str, dict[str, Any]] = {
    'experiments.bound': {'RANGES_M': (2.5, 3.8), '_GENIE_RECORDINGS': 1},
    'experiments.coffee': {'_QUICK_TRIALS': 1},
    'experiments.drone': {'QUICK_DURATION_S': 11.0},
    'experiments.ids': {'_DISTANCES': (12, 6)},
    'experiments.landmarks': {'_SIDES_M': (0.2, 0.4)},
    'experiments.moving': {'DURATION_S': 4.0},
    'experiments.peers': {
        '_QUICK_PICTURES': 2,
        '_SWEEPS': {
            name: (axis, (places[0], *places[:1:-6]), what, make)
            for name, (axis, places, what, make) in peers._SWEEPS.items()
        },
    },
    'experiments.paper_sweeps': {'TAG_RANGES_M': (1.0, 4.2)},
    'experiments.place': {'_QUICK_MARKERS': 12},
    'experiments.roc': {'_QUICK_SHARE': 0.0005},
    'experiments.rooms': {'QUICK_ROOMS': 2},
    'experiments.several': {'_QUICK_TRIALS': 1, '_RECORDINGS': 1},
    'experiments.speed_accuracy': {
        '_LONE_M': (1.0, 3.2),
        '_SEVERAL_M': (1.0, 4.0),
        '_FRAMES': 20,
        '_WARM_UP_S': 2.0,
    },
    'experiments.stability': {'PANELS': PANELS[:1], 'CONDITIONS': [(2.0, False)]},
    'experiments.tracks': {'DURATION_S': 5.0, '_QUICK_ROOMS': 2, '_SPEEDS_M_S': (0.0, 0.3)},
    'experiments.time_to_id': {'_RANGES_M': (1.0, 3.6)},
    'peers.camera': {'_LEAVES': 200},
    'peers.visual_markers': {'QUICK_PICTURES': 2},
}


@pytest.mark.parametrize('name', EXPERIMENTS)
def test_an_experiment_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, sizes in TINY.items():
        for attribute, value in sizes.items():
            monkeypatch.setattr(f'evaluation.{module}.{attribute}', value)
    for sweep in SWEEPS.values():
        ends = [
            replace(curve, places=(curve.places[0], curve.places[-1]), recordings=1)
            for curve in sweep.curves
        ]
        monkeypatch.setattr(sweep, 'curves', ends)
    words = run_experiment(name, tmp_path, quick=True, seed=1)
    assert 'QUICK RUN: ROUGH' in words
    figures = json.loads(
        (tmp_path / f'{name}.json').read_text(), parse_constant=lambda word: pytest.fail(word)
    )
    assert figures['run']['quick'] is True
    if hasattr(EXPERIMENTS[name], 'draw'):
        assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
    _, *lines, end = words.split('\n')
    assert not end
    rows = [line.count(' | ') for line in lines if line.startswith('| ')]
    claims = [line.count(' | ') for line in lines if not line.startswith('|')]
    assert len({*rows}) <= 1
    assert {*claims} <= {2}
