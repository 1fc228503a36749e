# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that ship with the package are found wherever it is installed."""

from pathlib import Path

import pytest

from retrolidar_ros.settings import resources
from retrolidar_ros.settings.resources import shared_file

Patch = pytest.MonkeyPatch


def install(directory: Path, monkeypatch: Patch) -> None:
    """Let the package be in a directory."""
    monkeypatch.setattr(resources, '_PACKAGE', directory / 'retrolidar_ros')


def test_the_message_definition_is_found() -> None:
    assert 'float32[] distance' in shared_file('msg/Frame.msg').read_text()


def test_a_source_tree_holds_its_own_files(tmp_path: Path, monkeypatch: Patch) -> None:
    root = tmp_path / 'src' / 'repository'
    install(root, monkeypatch)
    for directory in (root, tmp_path / 'share' / 'retrolidar_ros'):
        (directory / 'config').mkdir(parents=True)
        (directory / 'config' / 'driver.yaml').touch()
    assert shared_file('config/driver.yaml').is_relative_to(tmp_path / 'share')
    (root / 'package.xml').touch()
    assert shared_file('config/driver.yaml') == root / 'config' / 'driver.yaml'


@pytest.mark.parametrize(
    'packages', ['lib/python3.11/site', 'local/lib/python3.12/dist', 'lib64/python3.13/site']
)
def test_an_installed_package_finds_the_share_of_its_prefix(
    tmp_path: Path, packages: str, monkeypatch: Patch
) -> None:
    installed = tmp_path / f'{packages}-packages'
    install(installed, monkeypatch)
    shared = tmp_path / 'share' / 'retrolidar_ros' / 'msg' / 'Frame.msg'
    with pytest.raises(FileNotFoundError, match=r'msg/Frame\.msg') as caught:
        shared_file('msg/Frame.msg')
    assert str(shared.parents[1]) in str(caught.value)
    for file in (installed / 'msg' / 'Frame.msg', shared):
        file.parent.mkdir(parents=True)
        file.touch()
    assert shared_file('msg/Frame.msg') == shared
