# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML that is made to harm: it is refused at once, by a ValueError that says why."""

import time
from pathlib import Path

import numpy as np
import pytest

from retrolidar_ros.scene import parse_scene
from retrolidar_ros.scene.files import load_scene
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
        ('[' * 1500, 'RecursionError'),
        *((f'x: !!{text}', '') for text in ('timestamp foo', 'bool maybe', 'int ""', 'set [1]')),
        ('x: !!float "' + ':'.join(['59'] * 300) + '"', ''),
        ('x: !!binary "é"', ''),
        *((text, '') for text in ('[1, 2', 'a: b: c', '\t', '--- 1\n--- 2\n', '[' * 500)),
        *((f'? {key}\n: no key\n', '') for key in ('[1, 2]', '{a: b}')),
        ('a: !!python/object:os.system x', ''),
        ('a: 2026-02-30', ''),
        ('a: *nowhere', ''),
        (b'a: \xff\xfe', ''),
    ],
    ids=lambda value: str(value)[:20],
)
def test_what_is_no_yaml_or_harms_is_refused_with_the_reason(
    text: str | bytes, reason: str, tmp_path: Path
) -> None:
    path = tmp_path / 'hostile.yaml'
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    began = time.process_time()
    with pytest.raises(ValueError, match=reason or f'^{path} is not a YAML file: ') as caught:
        load_yaml(path)
    assert str(path) in str(caught.value)
    assert time.process_time() - began < 2.0
    if not reason:
        with pytest.raises(ConfigError, match=f'^{path} is not a YAML file: '):
            load_scene(str(path))


def test_what_never_ends_is_read_to_the_limit_and_what_is_no_file_is_an_os_error(
    tmp_path: Path,
) -> None:
    with pytest.raises(ValueError, match='is larger than'):
        load_yaml(Path('/dev/zero'))
    with pytest.raises(IsADirectoryError):
        load_yaml(tmp_path)
    with pytest.raises(FileNotFoundError):
        load_yaml(tmp_path / 'missing.yaml')


def test_so_many_markers_make_no_scene() -> None:
    marker = {'id': 7, 'position': ['0 m', '0 m', '1 m']}
    with pytest.raises(ConfigError, match='markers: 5000 of them; 256 are the most'):
        parse_scene({'markers': [marker] * 5000})


def test_noise_in_a_file_is_read_or_refused(tmp_path: Path) -> None:
    """Nothing but ValueError, for hundreds of damaged files."""
    whole = b'markers:\n  2073: {frame: &f beans, note: !!str x, size: 3 cm}\n  <<: {7: [1, *f]}\n'
    alphabet = np.frombuffer(b'!&*<>:[]{}"\'\n -?|%@`\t0x\xff\0' + whole, np.uint8)
    rng = np.random.default_rng(4)
    path, refused = tmp_path / 'noise.yaml', 0
    for _ in range(500):
        data = np.frombuffer(whole, np.uint8).copy()
        data[rng.integers(0, len(data), 6)] = rng.choice(alphabet, 6)
        path.write_bytes(data.tobytes())
        try:
            load_yaml(path)
        except ValueError:
            refused += 1
        with pytest.raises(ConfigError, match=f'^{path}'):
            load_scene(str(path))
    assert 150 < refused < 500
