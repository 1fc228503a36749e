# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML that is made to harm: it is refused at once, by a ValueError that says why."""

import time
from pathlib import Path

import numpy as np
import pytest

from retrolidar_ros.scene import parse_scene
from retrolidar_ros.settings.section import ConfigError
from retrolidar_ros.settings.yaml_files import load_yaml


def doubling(alias: str, levels: int) -> str:
    lines = ['a0: &a0 {x: 1}' if alias == '<<' else 'a0: &a0 [x, x]']
    for level in range(1, levels):
        before = f'*a{level - 1}'
        within = (
            f'{{<<: [{before}, {before}]}}' if alias == '<<' else f'[{", ".join([before] * 9)}]'
        )
        lines.append(f'a{level}: &a{level} {within}')
    return '\n'.join(lines)


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        (doubling('*', 12), 'it unfolds to'),
        (doubling('<<', 30), 'it unfolds to'),
        ('a: &a [*a]', 'an alias stands within'),
        ('x: ' + 'y' * 2**20, 'is larger than the 1048576 bytes'),
        ('[' * 5000, 'RecursionError'),
        ('x: !!timestamp foo', 'is not a YAML file'),
        ('x: !!bool maybe', 'is not a YAML file'),
        ('x: !!int ""', 'is not a YAML file'),
        ('x: !!set [1]', 'is not a YAML file'),
        ('x: !!float "' + ':'.join(['59'] * 300) + '"', 'is not a YAML file'),
        ('x: !!binary "é"', 'is not a YAML file'),
    ],
)
def test_what_harms_is_refused_with_the_reason(text: str, reason: str, tmp_path: Path) -> None:
    path = tmp_path / 'hostile.yaml'
    path.write_text(text, encoding='utf-8')
    began = time.process_time()
    with pytest.raises(ValueError, match=reason):
        load_yaml(path)
    assert time.process_time() - began < 2.0


def test_what_never_ends_is_read_to_the_limit_only() -> None:
    with pytest.raises(ValueError, match='is larger than'):
        load_yaml(Path('/dev/zero'))


def test_so_many_markers_make_no_scene() -> None:
    marker = {'id': 7, 'position': ['0 m', '0 m', '1 m']}
    with pytest.raises(ConfigError, match='markers: 5000 of them; 256 are the most'):
        parse_scene({'markers': [marker] * 5000})


def test_noise_in_a_file_is_read_or_refused(tmp_path: Path) -> None:
    """Nothing but ValueError, for thousands of damaged files."""
    whole = b'markers:\n  2073: {frame: &f beans, note: !!str x, size: 3 cm}\n  <<: {7: [1, *f]}\n'
    alphabet = np.frombuffer(b'!&*<>:[]{}"\'\n -?|%@`\t0x\xff' + whole, np.uint8)
    rng = np.random.default_rng(4)
    path, refused = tmp_path / 'noise.yaml', 0
    for _ in range(1500):
        data = np.frombuffer(whole, np.uint8).copy()
        data[rng.integers(0, len(data), 6)] = rng.choice(alphabet, 6)
        path.write_bytes(data.tobytes())
        try:
            load_yaml(path)
        except ValueError:
            refused += 1
    assert 500 < refused < 1500
