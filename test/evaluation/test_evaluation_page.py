# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The committed report and README against the figures, and the figures against the code."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from evaluation.command import main
from evaluation.experiments.registry import EXPERIMENTS, run_experiment
from evaluation.report.claims import NOTHING, Claim
from evaluation.report.page import PAGE, load, table, write_page
from evaluation.report.readme import BENCHMARKS, load_report, renewed

ROOT = Path(__file__).parents[2]
COMMITTED = ROOT / 'docs' / 'report'
REPORT = load_report(COMMITTED)
DOCUMENTS = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]


def test_a_page_tells_of_all_experiments(tmp_path: Path) -> None:
    for path in COMMITTED.glob('*.json'):
        shutil.copy(path, tmp_path)
    page = write_page(tmp_path).read_text(encoding='utf-8')
    for experiment in EXPERIMENTS.values():
        assert f'\n## {experiment.TITLE}\n' in page


def test_the_committed_run_is_whole_and_says_of_what() -> None:
    report = load(COMMITTED)
    assert report.keys() == EXPERIMENTS.keys()
    for name, figures in report.items():
        assert figures['run']['quick'] is False, name
        assert (COMMITTED / f'{name}.png').exists()
    page = (COMMITTED / PAGE).read_text(encoding='utf-8')
    run = report['ranging']['run']
    for said in (run['processor'], run['python'], run['versions']['numpy'], f'seed {run["seed"]}'):
        assert said in page


@pytest.mark.parametrize('name', EXPERIMENTS)
def test_every_experiment_sets_the_paper_beside_ours(name: str) -> None:
    figures = load(COMMITTED)[name]
    experiment = EXPERIMENTS[name]
    claims = experiment.compare(figures)
    assert all(isinstance(claim, Claim) and claim.default != NOTHING for claim in claims[:1])
    assert len(experiment.comment(figures)) > 80
    assert experiment.TITLE
    if experiment.SOURCE:
        assert re.match(r'paper §\d', experiment.SOURCE)
        assert any(claim.paper != NOTHING for claim in claims)


@pytest.mark.parametrize('document', DOCUMENTS, ids=lambda path: path.name)
def test_the_figures_of_a_document_are_renewed(document: Path) -> None:
    text = document.read_text(encoding='utf-8')
    blocks = re.findall(r'<!-- figures: \S+ -->\n(.*?)<!-- end', renewed(text, REPORT), re.DOTALL)
    assert len(blocks) == text.count('<!-- figures: ')
    assert all(block.startswith('|') for block in blocks)


def test_figures_of_benchmarks_say_on_what_they_were_measured() -> None:
    report = load_report(COMMITTED)
    for name in BENCHMARKS:
        assert report[name]['run']['processor']


def test_a_table_leaves_out_columns_that_say_nothing() -> None:
    claims = [Claim('reach', default='2 m'), Claim('angle', default='3°')]
    assert table(claims).splitlines()[0] == '|  | default, `joint` |'
    claims.append(Claim('time', '5 s', '6 s', '7 s'))
    assert table(claims).splitlines()[-1] == '| time | 5 s | 6 s | 7 s |'


def test_without_a_name_the_experiments_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(EXPERIMENTS)


def test_a_quick_look_does_not_overwrite_the_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['power', '--quick']) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ['report_quick']
    assert (tmp_path / 'report_quick' / 'power.png').exists()
    assert capsys.readouterr().out.endswith('report_quick\n')


def test_several_experiments_at_once_are_the_same_as_one_by_one(tmp_path: Path) -> None:
    together, alone = tmp_path / 'together', tmp_path / 'alone'
    alone.mkdir()
    assert main(['power', 'ids', '--quick', '-o', str(together)]) == 0
    for name in ('power', 'ids'):
        run_experiment(name, alone, quick=True, seed=1)
        one, other = (json.loads((at / f'{name}.json').read_text()) for at in (together, alone))
        del one['run'], other['run']
        assert one == other


def test_the_command_runs_several_at_once(tmp_path: Path) -> None:
    command = [sys.executable, '-m', 'evaluation', 'power', 'ids', '--quick', '-o', str(tmp_path)]
    finished = subprocess.run(
        command, check=True, capture_output=True, text=True, timeout=60, cwd=ROOT
    )
    assert sorted(path.name for path in tmp_path.glob('*.json')) == ['ids.json', 'power.json']
    assert finished.stdout.count('power\n') == 1


def test_an_experiment_writes_chart_and_figures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['reading', '--quick', '-o', str(tmp_path)]) == 0
    figures = json.loads((tmp_path / 'reading.json').read_text())
    assert (tmp_path / 'reading.png').read_bytes().startswith(b'\x89PNG\r\n\x1a\n')
    woken = {row['range_m']: row['woken'] for row in figures['by_range']}
    # The paper's chain mislocks near by as well, and fades towards its reach.
    assert 0.5 < woken[1.0]['paper']['right']['rate'] < 0.95
    assert woken[1.0]['paper']['wrong']['rate'] > 0.03
    assert woken[1.0]['joint']['right']['rate'] == 1.0
    assert woken[1.0]['joint']['wrong']['rate'] == 0.0
    assert figures['run']['seed'] == 1
    assert 'repeating' in capsys.readouterr().out


def test_an_unknown_experiment_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['nothing']) == 2
    assert "unknown experiment 'nothing'; there is chain" in capsys.readouterr().err
