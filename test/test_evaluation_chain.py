# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The chain on one zone: its stages against the truth, and its document against its figures."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from retrolidar_ros.code import PACKET_BITS, PREAMBLE, packet
from retrolidar_ros.detector.report import detection_of
from retrolidar_ros.evaluation import chain
from retrolidar_ros.evaluation.chain import STAGES
from retrolidar_ros.evaluation.chain.played import Played, marker_before_wall, play
from retrolidar_ros.evaluation.chain.stages import find
from retrolidar_ros.evaluation.live import ELLIPSOID
from retrolidar_ros.markers import MARKER_SIZE_M
from retrolidar_ros.scene.description import Surface

DOCS = Path(__file__).parent.parent / 'docs'
DOCUMENT = (DOCS / 'how_it_works.md').read_text(encoding='utf-8')
# A measured number is followed by its place in the figures, in a comment that nobody sees.
MEASURED = re.compile(r'(-?\d+(?:\.\d+)?(?:e-\d+)?)<!--([\w.]+)-->')


@pytest.fixture(scope='module')
def figures() -> dict[str, Any]:
    made = chain.run(np.random.default_rng(4), quick=True)
    read: dict[str, Any] = json.loads(json.dumps(made, allow_nan=False))
    return read


@pytest.fixture(scope='module')
def played() -> Played:
    scene = marker_before_wall(77, (0.3, 0.2, 1.8), Surface(2.0, 8.0), start_s=2.0, packets=1)
    return play(scene, np.random.default_rng(0), 4.5)


def test_the_stages_come_to_what_the_detector_says(played: Played) -> None:
    found = find(played)
    origin_ns, grid = int(played.recording.stamp_ns[0]), played.recording.grid
    again = detection_of(found.reading, played.samples, origin_ns, grid, MARKER_SIZE_M)
    assert again is not None
    assert again.id == played.detection.id == 77
    assert again.start_ns == played.detection.start_ns
    assert again.zones == played.detection.zones
    assert again.score == pytest.approx(played.detection.score, rel=1e-9)
    assert again.place.position_m == pytest.approx(played.detection.place.position_m, rel=1e-9)


def test_the_right_id_peaks_at_the_right_start(figures: dict[str, Any]) -> None:
    search, marker = figures['search'], figures['marker']
    assert search['id'] == search['top_ids'][0] == marker['id']
    assert search['top_distance'][0] == 0
    assert min(search['top_distance'][1:]) >= 8
    assert search['top_correlation'][1] < search['threshold'] + 0.1 < search['correlation'] + 0.1
    peak = search['start_s'][int(np.argmax(search['best']))]
    assert peak == pytest.approx(marker['start_s'], abs=0.25 * figures['bit_s'])
    assert abs(figures['fit']['start_error_ms']) < 5
    assert sum(search['ids_at_start']) == 4094


def test_the_soft_bits_and_the_light_are_those_of_the_packet(figures: dict[str, Any]) -> None:
    bits = np.array(figures['bits']['bits'])
    assert bits.tolist() == packet(figures['marker']['id']).tolist()
    assert bits[: len(PREAMBLE)].tolist() == PREAMBLE.tolist()
    soft = np.array(figures['soft']['value'])
    assert soft.shape == (PACKET_BITS,)
    assert soft[bits == 1].min() > soft[bits == 0].max()
    # Exposures that straddle an edge are grey, most others are not.
    exposed = np.array(figures['bits']['exposed'])
    assert 0 <= exposed.min() < 0.1
    assert 0.95 < exposed.max() <= 1


def test_what_is_left_over_is_noise(figures: dict[str, Any]) -> None:
    fit, left = figures['fit'], np.array(figures['fit']['normalised'])
    freedom = len(left) - 6
    assert left @ left / freedom == pytest.approx(fit['residual'], abs=0.02)
    assert 0.6 < fit['residual'] < figures['evidence']['most_residual']
    expected, signal = np.array(fit['expected']), np.array(fit['signal'])
    assert (signal - expected).std() == pytest.approx(fit['deviation'], rel=0.1)


def test_evidence_is_beyond_its_limits(figures: dict[str, Any]) -> None:
    evidence = figures['evidence']
    assert evidence['nats'] >= evidence['least_nats']
    assert evidence['lead'] >= evidence['least_lead'] == pytest.approx(np.log(1000), abs=0.05)
    assert evidence['zones'][0] == figures['samples']['zone']


def test_packets_together_stand_out_more_than_each(figures: dict[str, Any]) -> None:
    fold = figures['fold']
    assert fold['packets'] >= 3
    assert fold['id'] == figures['marker']['id']
    together = np.sum(fold['rows'], axis=0)
    assert np.array(fold['folded']) == pytest.approx(together, abs=0.05)
    assert fold['folded_snr_db'] > fold['mean_row_snr_db'] + 2
    assert max(fold['single_correlation']) < fold['single_threshold']
    assert fold['threshold'] < fold['correlation']
    assert fold['folded_hard_errors'] < max(fold['hard_errors'])


def test_the_background_is_taken_off_the_range(figures: dict[str, Any]) -> None:
    place = figures['place']
    assert abs(place['range_error_mm']) < 4 * place['range_stddev_mm']
    assert place['mean_mm'] - place['truth_mm'] > 100
    amplitude = np.array(place['amplitude'])
    assert amplitude.argmax() == figures['samples']['zone']
    # The neighbour towards which the marker hangs sees it, too.
    assert np.sort(amplitude)[-2] == amplitude[amplitude.argmax() - 1]
    assert place['squared_distance'] < 2 * ELLIPSOID


def test_the_papers_likelihood_peaks_at_the_start_or_at_its_trap(figures: dict[str, Any]) -> None:
    paper, mislock = figures['paper'], figures['mislock']
    assert paper['largest'] == pytest.approx(max(paper['likelihood']), abs=0.01)
    assert paper['largest'] > paper['threshold']
    assert abs(paper['start_error_ms']) < 1e3 * figures['bit_s'] / 2
    assert paper['id'] == figures['marker']['id']
    assert paper['read'] == [paper['id']]
    example = mislock['example']
    assert example['bits'][len(PREAMBLE) :][:2] == [0, 1]
    assert example['late_bits'] == pytest.approx(2, abs=0.6)
    assert example['read_id'] not in (example['id'], -1)
    assert example['likelihood_taken'] >= example['likelihood_right']
    assert mislock['packets'] >= mislock['continuing'] >= mislock['late'] >= mislock['late_wrong']
    assert mislock['default_right'] > 0.9 * mislock['packets']
    assert mislock['default_wrong'] == 0


def test_every_stage_is_drawn(figures: dict[str, Any], tmp_path: Path) -> None:
    chain.draw(figures, tmp_path / 'chain.png')
    names = {f'chain-{index}-{name}.png' for index, name in enumerate(STAGES, start=1)}
    assert {path.name for path in tmp_path.iterdir()} == names | {'chain.png'}
    overview = (tmp_path / 'chain.png').read_bytes()
    assert overview.startswith(b'\x89PNG')
    height = int.from_bytes(overview[20:24], 'big')
    single = int.from_bytes((tmp_path / min(names)).read_bytes()[20:24], 'big')
    assert height == single * len(STAGES)


def test_words_about_it(figures: dict[str, Any]) -> None:
    assert f'correlation {figures["search"]["correlation"]:.3f}' in chain.summarise(figures)
    claims = chain.compare(figures)
    assert claims[0].default == claims[0].method == str(figures['marker']['id'])
    text = chain.comment(figures)
    assert f'ID {figures["mislock"]["example"]["id"]} as' in text
    assert 'None' not in text


def at(figures: Any, path: str) -> float:
    """Return the figure at a dotted path; numbers in it count along lists."""
    for step in path.split('.'):
        figures = figures[int(step)] if isinstance(figures, list) else figures[step]
    return float(figures)


def test_the_documents_numbers_are_those_of_the_report() -> None:
    figures = json.loads((DOCS / 'report' / 'chain.json').read_text(encoding='utf-8'))
    assert not figures['run']['quick']
    measured = MEASURED.findall(DOCUMENT)
    assert len(measured) == DOCUMENT.count('<!--') > 50
    for text, path in measured:
        kind = 'e' if 'e' in text else 'f'
        digits = len(text.partition('e')[0].partition('.')[2])
        assert f'{at(figures, path):.{digits}{kind}}' == text, path


def test_the_document_shows_every_stage_and_is_no_longer_than_it_may_be() -> None:
    shown = re.findall(r'!\[[^\]]+\]\((report/chain-[^)]+)\)', DOCUMENT)
    assert shown == [
        f'report/chain-{number}-{name}.png' for number, name in enumerate(STAGES, start=1)
    ]
    for link in re.findall(r'\]\(([^)]+)\)', DOCUMENT):
        assert (DOCS / link).exists(), link
    assert len(DOCUMENT.splitlines()) <= 250
