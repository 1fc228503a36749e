# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files of landmarks, written such that no map on disk is lost."""

import os
import shutil
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of, quaternion_of
from retrolidar_ros.settings.files import load_parsed, yaml_text
from retrolidar_ros.settings.section import ConfigError, keyed, text
from retrolidar_ros.tasks.landmarks import Estimate
from retrolidar_ros.tasks.reading import KnownPose

_BACKUP = '.bak'
_MAX_NAMED = 5


def load_survey(path: Path) -> tuple[str, dict[str, KnownPose]]:
    """Return the fixed frame and the landmarks of a file; errors as of `load_parsed`."""
    return load_parsed(path, parse_survey)


def check_target(path: Path) -> None:
    """Raise ValueError if a file cannot be written at a path."""
    if path.is_dir():
        raise ValueError(f'{path} is a directory; name a file in it')
    if not path.parent.is_dir():
        raise ValueError(f'there is no directory {path.parent}; make it first')


def save_survey(path: Path, frame: str, estimates: list[Estimate]) -> str:
    """Write landmarks, whose estimates are in a fixed frame, and return what was done.

    The file is written beside and renamed, so there is always a whole one; the one before is kept,
    with `.bak` after its name. OSError if a file cannot be read or written; ValueError if something
    would be lost: there is no landmark, or the file is no map, or one in another frame or with
    others.
    """
    if not estimates:
        raise ValueError('nothing is placed, and an empty map is not written; delete it by hand')
    check_target(path)
    path = path.resolve()  # the target of a link is replaced
    exists = path.exists()
    if exists:
        _check_replaceable(path, frame, {one.name for one in estimates})
    content = yaml_text(survey_content(frame, estimates))
    done = f'{len(estimates)} landmarks in {frame} saved to {path}'
    if exists and path.read_text(encoding='utf-8') == content:
        return f'{done}, unchanged'
    kept = path.with_name(path.name + _BACKUP)
    try:
        with _replacing(path) as fresh:
            fresh.write_text(content, encoding='utf-8')
            load_survey(fresh)  # check that it can be loaded
            if exists:
                shutil.copymode(path, fresh)
                with _replacing(kept) as copy:
                    shutil.copy2(path, copy)
    except OSError as error:
        raise OSError(f'{path} cannot be written: {error.strerror}') from error
    return f'{done}; the file before is {kept}' if exists else done


@contextmanager
def _replacing(path: Path) -> Iterator[Path]:
    """Yield a path beside another one, whose file replaces that once it is on the disk."""
    fresh = path.with_name(f'.{path.name}.{os.getpid()}')
    try:
        yield fresh
        _flush(fresh)
        fresh.replace(path)
        _flush(path.parent)
    finally:
        fresh.unlink(missing_ok=True)


def _check_replaceable(path: Path, frame: str, names: Collection[str]) -> None:
    """Raise ValueError if a file has content that would be lost."""
    if path.is_file() and not path.stat().st_size:
        return
    try:
        other, known = load_survey(path)
    except ValueError as error:
        raise ValueError(f'{error}; a file that is not a map is not replaced') from error
    if other != frame:
        raise ValueError(
            f'the landmarks in {path} are in {other}, these in {frame}; move it away first'
        )
    if missing := sorted(known.keys() - names):
        more = ', …' if len(missing) > _MAX_NAMED else ''
        raise ValueError(
            f'{len(missing)} landmarks in {path} are not placed now and would be lost: '
            f'{", ".join(missing[:_MAX_NAMED])}{more}; set load_file to it, or move it away first'
        )


def _flush(path: Path) -> None:
    """Wait until a file, or a directory, is on the disk."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def survey_content(frame: str, estimates: list[Estimate]) -> dict[str, Any]:
    """Return landmarks in a fixed frame as a mapping fit for a YAML file; units are SI."""
    return {
        'frame': frame,
        'landmarks': {
            one.name: {
                'position': one.position_m.tolist(),
                'orientation': quaternion_of(one.rotation).tolist(),
                'covariance': one.covariance.ravel().tolist(),
            }
            for one in estimates
        },
    }


def parse_survey(content: object) -> tuple[str, dict[str, KnownPose]]:
    """Return what `survey_content` wrote; ConfigError if numbers are missing or impossible."""
    found = keyed({'frame': text, 'landmarks': _poses})(content, '')
    return found['frame'], found['landmarks']


def _poses(value: Any, path: str) -> dict[str, KnownPose]:
    if not isinstance(value, Mapping):
        raise ConfigError(f'{path}: needs a name and a place a line, not {value!r}')
    return {str(name): _pose(one, f'{path}.{name}') for name, one in value.items()}


def _pose(value: Any, path: str) -> KnownPose:
    sizes = {'position': 3, 'orientation': 4, 'covariance': 36}
    found = keyed({key: _numbers(size) for key, size in sizes.items()})(value, path)
    turn, covariance = found['orientation'], found['covariance'].reshape(6, 6)
    if not np.linalg.norm(turn) > 0:
        raise ConfigError(f'{path}.orientation: is no quaternion')
    if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] <= 0:
        raise ConfigError(f'{path}.covariance: is not symmetric and above 0')
    return KnownPose(found['position'], matrix_of(turn), covariance)


def _numbers(count: int) -> Callable[[Any, str], Floats]:
    def parse(value: Any, path: str) -> Floats:
        try:
            numbers: Floats = np.array(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            numbers = np.array([])
        if numbers.shape != (count,) or not np.isfinite(numbers).all():
            raise ConfigError(f'{path}: needs a list of {count} numbers, not {value!r:.200}')
        return numbers

    return parse
