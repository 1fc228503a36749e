# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The committed report and README against the figures, and the figures against the code."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import pytest

from evaluation.__main__ import main
from evaluation.experiments.registry import EXPERIMENTS, run_experiment
from evaluation.report.readme import ALL, PAGE, filled, load, renewed, write_page

ROOT = Path(__file__).parents[2]
COMMITTED = ROOT / 'docs' / 'report'
PAGES = sorted((ROOT / 'evaluation' / 'report' / 'pages').glob('*.md'))
DOCUMENTS = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]


def test_every_experiment_has_its_chart_in_the_report() -> None:
    chapters = ''.join(path.read_text(encoding='utf-8') for path in PAGES)
    for name in EXPERIMENTS:
        assert f'{{{{chart {name}}}}}' in chapters, name


def test_the_committed_run_is_whole_and_says_of_what() -> None:
    report = load(COMMITTED)
    assert report.keys() == EXPERIMENTS.keys()
    for name, figures in report.items():
        assert figures['run']['quick'] is False, name
        assert (COMMITTED / f'{name}.png').exists()
    page = (COMMITTED / PAGE).read_text(encoding='utf-8')
    run = report['ranging']['run']
    for said in (run['processor'], run['python'], run['versions']['numpy'], str(run['seed'])):
        assert said in page


def test_the_committed_page_is_that_of_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def draw(name: str, figures: dict[str, Any], _: Path) -> None:
        plt.close(EXPERIMENTS[name].draw(figures))  # to write it takes long

    monkeypatch.setattr('evaluation.report.readme.save_chart', draw)
    for path in COMMITTED.glob('*.json'):
        shutil.copy(path, tmp_path)
    page = write_page(tmp_path).read_text(encoding='utf-8')
    assert page == (COMMITTED / PAGE).read_text(encoding='utf-8')
    assert len(page.replace('|', ' ').split()) <= 4700


def test_a_slot_that_nothing_fills_is_named() -> None:
    with pytest.raises(ValueError, match='chart nothing'):
        filled('{{chart nothing}}', {})
    report = load(COMMITTED)
    with pytest.raises(ValueError, match='claim bound reach'):
        filled('{{claim bound reach}}', report)


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
    command = [sys.executable, '-m', 'evaluation', 'chain', 'link', '--quick', '-o', str(together)]
    finished = subprocess.run(
        command, check=True, capture_output=True, text=True, timeout=60, cwd=ROOT
    )
    assert finished.stdout.count('chain: One packet') == 1
    assert sorted(path.name for path in together.glob('*.json')) == ['chain.json', 'link.json']
    for name in ('chain', 'link'):
        run_experiment(name, alone, quick=True, seed=1)
        one, other = (json.loads((at / f'{name}.json').read_text()) for at in (together, alone))
        del one['run'], other['run']
        assert one == other


def test_an_unknown_experiment_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['nothing']) == 2
    assert "unknown experiment 'nothing'; there is speed-accuracy" in capsys.readouterr().err
