# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The code has the published properties of the Golay code and the committed form."""

import runpy
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from retrolidar_ros.marker.code import (
    IDS,
    PACKET_BITS,
    PREAMBLE,
    RESERVED_IDS,
    WORD_BITS,
    WORDS,
    check_ids,
    decode,
    packet,
)

Bits = NDArray[np.uint8]

VECTORS = Path(__file__).parents[1] / 'vectors'
GENERATOR: Bits = WORDS[1 << np.arange(11, -1, -1)]
PARITY_CHECK: Bits = np.hstack([GENERATOR[:, 12:].T, np.eye(12, dtype=np.uint8)])
COSETS = {0: 1, 1: 24, 2: 276, 3: 2024, 4: 1771}  # Conway and Sloane 1988, by leader's weight

ids = st.integers(0, IDS - 1)


def error_patterns(weight: int) -> Bits:
    places = np.array(list(combinations(range(WORD_BITS), weight)), dtype=np.intp)
    patterns = np.zeros((len(places), WORD_BITS), dtype=np.uint8)
    np.put_along_axis(patterns, places, 1, axis=1)
    return patterns


def test_all_words_are_the_committed_ones_which_another_library_has_made(
    capsys: pytest.CaptureFixture[str],
) -> None:
    committed = (VECTORS / 'golay.txt').read_text().splitlines()[-IDS:]
    expected = [[int(digit) for digit in f'{int(line.split()[1], 16):024b}'] for line in committed]
    assert [int(line.split()[0]) for line in committed] == list(range(IDS))
    np.testing.assert_array_equal(WORDS, expected)
    pytest.importorskip('komm', reason='komm computes the vectors')
    runpy.run_path(str(VECTORS / 'make_golay.py'), run_name='__main__')
    made = [line for line in capsys.readouterr().out.splitlines() if not line.startswith('#')]
    assert made == committed


def test_weights_of_the_words_are_those_published() -> None:
    weights, counts = np.unique(WORDS.sum(axis=1), return_counts=True)
    expected = {0: 1, 8: 759, 12: 2576, 16: 759, 24: 1}
    assert dict(zip(weights.tolist(), counts.tolist(), strict=True)) == expected


def test_weights_of_the_coset_leaders_are_those_published() -> None:
    leaders = np.full(IDS, -1)
    for weight in reversed(COSETS):
        syndromes = error_patterns(weight) @ PARITY_CHECK.T % 2 @ (1 << np.arange(12))
        leaders[syndromes] = weight
    weights, counts = np.unique(leaders, return_counts=True)
    assert dict(zip(weights.tolist(), counts.tolist(), strict=True)) == COSETS


@pytest.mark.parametrize('weight', range(6))
def test_three_errors_are_corrected_four_refused_and_five_taken_for_three(weight: int) -> None:
    patterns = error_patterns(weight)
    sent = np.random.default_rng(weight).integers(0, IDS, (8 if weight < 4 else 1, len(patterns)))
    ids_, corrected_bits = decode(WORDS[sent] ^ patterns)
    assert (corrected_bits == (weight if weight < 4 else {4: -1, 5: 3}[weight])).all()
    expected = {4: ids_ == -1, 5: ids_ != sent}.get(weight, ids_ == sent)
    assert expected.all()


def test_a_packet_is_the_preamble_and_the_word_most_significant_bit_first() -> None:
    np.testing.assert_array_equal(PREAMBLE, [1, 0, 1, 0, 1, 0, 1])
    bits = packet(0b1000_0000_0011)
    assert ''.join(map(str, bits)) == '1010101' + '100000000011' + '100011011000'
    assert bits.dtype == np.uint8
    assert PACKET_BITS == 31


def test_reserved_ids_have_words_without_modulation() -> None:
    constant = np.flatnonzero(np.ptp(WORDS, axis=1) == 0)
    assert tuple(constant) == RESERVED_IDS


@given(shape=hnp.array_shapes(min_dims=0, max_dims=4, min_side=0, max_side=4), data=st.data())
def test_any_batch_shape(shape: tuple[int, ...], data: st.DataObject) -> None:
    sent = data.draw(hnp.arrays(np.int64, shape, elements=ids))
    assert packet(sent).shape == (*shape, PACKET_BITS)
    decoded = decode(packet(sent)[..., len(PREAMBLE) :])
    assert decoded.ids.shape == decoded.corrected_bits.shape == shape
    np.testing.assert_array_equal(decoded.ids, sent)


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        (-1, r'marker ID -1 is outside 0\.\.4095'),
        ([[5, 4096]], r'marker ID 4096 is outside 0\.\.4095'),
        (2**63, r'marker ID 9223372036854775808 is outside'),
        (2**64, 'must be an integer, not object'),
        (1.0, 'must be an integer, not float64'),
        (True, 'must be an integer, not bool'),
        ('7', 'must be an integer, not <U1'),
    ],
)
def test_values_that_are_no_id(wrong: object, message: str) -> None:
    for function in (check_ids, packet):
        with pytest.raises(ValueError, match=message):
            function(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('wrong', 'message'),
    [
        (1, r'24 bits on its last axis, not shape \(\)'),
        (np.zeros((24, 2)), r'24 bits on its last axis, not shape \(24, 2\)'),
        (np.full(24, 2), 'only 0 and 1'),
        (np.full((2, 24), 0.5), 'only 0 and 1'),
        (np.full(24, np.nan), 'only 0 and 1'),
    ],
)
def test_values_that_are_no_word(wrong: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        decode(wrong)  # type: ignore[arg-type]
