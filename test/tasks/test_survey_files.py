# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import errno
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from harness_readings import HERE, estimate_of, mapped

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.files import MAX_BYTES
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.reading import Errors, KnownPose
from retrolidar_ros.tasks.survey import MAX_LANDMARKS
from retrolidar_ros.tasks.survey_files import load_survey, save_survey


def estimates(*names: str, at_m: Floats = HERE) -> list[Estimate]:
    return [mapped(name, at_m) for name in names]


@contextmanager
def refused(path: Path, error: type[Exception], message: str) -> Iterator[None]:
    """Check that an attempt fails, changes nothing and leaves nothing beside."""
    before = path.read_bytes()
    with pytest.raises(error, match=message):
        yield
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def names_in(path: Path) -> set[str]:
    return set(load_survey(path)[1])


@pytest.fixture
def room(tmp_path: Path) -> Path:
    path = tmp_path / 'room.yaml'
    assert '2 landmarks in map' in save_survey(path, 'map', estimates('lamp', 'tray'))
    return path


def test_the_map_before_is_kept_and_nothing_else_is_left(room: Path) -> None:
    before = room.read_bytes()
    room.chmod(0o640)
    answer = save_survey(room, 'map', estimates('lamp', 'tray', 'mug'))
    backup = room.with_name('room.yaml.bak')
    assert backup.read_bytes() == before
    assert str(backup) in answer
    assert names_in(room) == {'lamp', 'tray', 'mug'}
    assert stat.S_IMODE(room.stat().st_mode) == 0o640
    assert {one.name for one in room.parent.iterdir()} == {'room.yaml', 'room.yaml.bak'}
    # The same again would push the older one out of the backup.
    assert 'unchanged' in save_survey(room, 'map', estimates('lamp', 'tray', 'mug'))
    assert backup.read_bytes() == before


@pytest.mark.parametrize(
    ('frame', 'names', 'message'),
    [
        ('map', (), 'nothing is placed'),
        ('odom', ('lamp', 'tray'), r'are in map, these in odom'),
        ('map', ('lamp', 'mug'), r'1 landmarks in .* would be lost: tray; set load_file'),
    ],
)
def test_a_map_that_would_lose_something_is_not_replaced(
    room: Path, frame: str, names: tuple[str, ...], message: str
) -> None:
    with refused(room, ValueError, message):
        save_survey(room, frame, estimates(*names))


@pytest.mark.parametrize('content', ['markers: {}', 'a line of a diary', 'frame: [', '\x00'])
def test_what_is_no_map_is_not_replaced(tmp_path: Path, content: str) -> None:
    path = tmp_path / 'diary'
    path.write_text(content)
    with refused(path, ValueError, 'is not a map'):
        save_survey(path, 'map', estimates('lamp'))


def test_a_link_stays_a_link(room: Path) -> None:
    link = room.with_name('link.yaml')
    link.symlink_to(room)
    save_survey(link, 'map', estimates('lamp', 'tray', 'mug'))
    assert link.is_symlink()
    assert names_in(room) == {'lamp', 'tray', 'mug'}


@pytest.mark.parametrize('step', ['write_text', 'replace', 'fsync', 'copy2'])
def test_a_bad_disk_costs_nothing(room: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, 'No space left on device')

    owners: dict[str, str] = {'fsync': 'os', 'copy2': 'shutil'}
    monkeypatch.setattr(f'{owners.get(step, "pathlib.Path")}.{step}', fail)
    with refused(room, OSError, f'^{room} cannot be written: No space left on device$'):
        save_survey(room, 'map', estimates('lamp', 'tray', 'mug'))


@pytest.mark.parametrize(
    'spoil',
    [
        lambda one: one.covariance.fill(np.nan),
        lambda one: one.covariance.fill(0.0),
        lambda one: one.position_m.fill(np.inf),
    ],
)
def test_an_unloadable_map_is_not_written(room: Path, spoil: Callable[[Estimate], None]) -> None:
    spoilt = estimates('lamp', 'tray', at_m=HERE.copy())
    spoil(spoilt[1])
    with refused(room, ValueError, r'landmarks\.'):
        save_survey(room, 'map', spoilt)


def test_names_that_yaml_takes_for_something_else_come_back(tmp_path: Path) -> None:
    names = ['on', 'null', '12', '1e3', '<<', '~', 'a: b', 'größe', "'", '#x']
    save_survey(tmp_path / 'room.yaml', 'map', estimates(*names))
    assert names_in(tmp_path / 'room.yaml') == set(names)


def test_as_many_landmarks_as_are_kept_fit_into_a_file(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    some = []
    for index in range(20):
        root = rng.normal(size=(6, 6))
        prior = KnownPose(rng.normal(size=3), np.eye(3), root @ root.T)
        some.append(estimate_of(Landmark(f'{index:0>100}', {}, Errors(), prior)))
    path = tmp_path / 'room.yaml'
    save_survey(path, 'map', some)
    assert len(names_in(path)) == len(some)
    assert path.stat().st_size / len(some) * MAX_LANDMARKS < MAX_BYTES
