# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that ship with the package are found wherever it is installed."""

import shutil
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from retrolidar_ros.settings import resources


def module_in(directory: Path) -> ModuleType:
    """Load a copy of the module from a package in the directory."""
    package = directory / 'retrolidar_ros' / 'settings'
    package.mkdir(parents=True)
    copy = Path(shutil.copy(resources.__file__, package))
    spec = spec_from_file_location('resources_elsewhere', copy)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_message_definition_is_found() -> None:
    assert 'float32[] distance' in resources.shared_file('msg/Frame.msg').read_text()


def test_a_source_tree_holds_its_own_files(tmp_path: Path) -> None:
    root = tmp_path / 'src' / 'repository'
    module = module_in(root)
    for directory in (root, tmp_path / 'share' / 'retrolidar_ros'):
        (directory / 'config').mkdir(parents=True)
        (directory / 'config' / 'driver.yaml').touch()
    assert module.shared_file('config/driver.yaml').is_relative_to(tmp_path / 'share')
    (root / 'package.xml').touch()
    assert module.shared_file('config/driver.yaml') == root / 'config' / 'driver.yaml'


PACKAGES = ['lib/python3.11/site', 'local/lib/python3.12/dist', 'lib64/python3.13/site']


@pytest.mark.parametrize('packages', [f'{path}-packages' for path in PACKAGES])
def test_an_installed_package_finds_the_share_of_its_prefix(tmp_path: Path, packages: str) -> None:
    module = module_in(tmp_path / packages)
    (tmp_path / packages / 'msg').mkdir()
    (tmp_path / packages / 'msg' / 'Frame.msg').touch()
    shared = tmp_path / 'share' / 'retrolidar_ros' / 'msg' / 'Frame.msg'
    shared.parent.mkdir(parents=True)
    shared.touch()
    assert module.shared_file('msg/Frame.msg') == shared


def test_a_missing_file_is_named_with_the_places_searched(tmp_path: Path) -> None:
    module = module_in(tmp_path / 'lib' / 'python3.11' / 'site-packages')
    with pytest.raises(FileNotFoundError, match=r'launch/no\.py') as caught:
        module.shared_file('launch/no.py')
    assert str(tmp_path / 'share' / 'retrolidar_ros') in str(caught.value)
