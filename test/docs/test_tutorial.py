# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tutorial does what it says."""

import os
import re
import shutil
from pathlib import Path

import pytest
from markdown_runner import matches, run_page

TUTORIAL = Path(__file__).parents[2] / 'docs' / 'tutorial.md'
PAGE = """
```console
no such command
```
Save as
`two.txt`:
```yaml
one: 1
two: 2
```
```bash
number=$(wc -l < two.txt)
```
```bash
echo "$number lines of $RANDOM"
echo nonsense
echo the end
```
```text
2 lines of …
…
the end
```
"""


def test_a_page_that_is_right(tmp_path: Path) -> None:
    run_page(PAGE, tmp_path, os.environ, 10.0)
    assert (tmp_path / 'two.txt').read_text() == 'one: 1\ntwo: 2\n'


@pytest.mark.parametrize(
    ('right', 'wrong', 'complaint'),
    [
        ('2 lines of …', '3 lines of …', 'line 14: exit code 0, and the output is\n2 lines'),
        ('the end\n```\n', 'the end\nmore\n```\n', 'line 14: exit code 0'),
        ('echo nonsense', 'false', 'line 14: exit code 1'),
        ('number=$(wc', 'number=$(wrong', 'line 11: exit code 127'),
        ('echo nonsense', 'sleep 60', 'line 14: exit code None'),
        ('echo nonsense', 'sleep 60 &', 'still running'),
        ('Save as', 'Or as', 'line 7: this block has no'),
        ('```text', 'words\n```text', 'line 20: there are no commands'),
        ('```console', '```rust', 'unknown kind of block rust'),
    ],
)
def test_a_page_that_is_wrong(tmp_path: Path, right: str, wrong: str, complaint: str) -> None:
    assert right in PAGE
    with pytest.raises(AssertionError, match=re.escape(complaint)):
        run_page(PAGE.replace(right, wrong), tmp_path, os.environ, 2.0)


def test_dots_stand_for_text_of_a_line_and_for_lines() -> None:
    for pattern, good, bad in (
        ('a … c\n', 'a b c\n', 'a b\nb c\n'),
        ('a\n…\nc\n', 'a\nb\nb\nc\n', 'a\nb\n'),
        ('a\n…\nc\n', 'a\nc\n', 'c\n'),
        ('a.c\n', 'a.c\n', 'abc\n'),
    ):
        assert matches(pattern, good)
        assert not matches(pattern, bad)


def test_the_tutorial(tmp_path: Path) -> None:
    pytest.importorskip('rclpy', reason='needs ROS 2')
    pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')
    pytest.importorskip('rosbags', reason='needs rosbags, which is a pip extra')
    pytest.importorskip('matplotlib', reason='needs matplotlib, which is a pip extra')
    command = shutil.which('retrolidar')
    if command is None or not (Path(command).parents[1] / 'lib/retrolidar_ros/detector').exists():
        pytest.skip('needs the executables on PATH: source install/setup.bash, or embedded/run')
    directory = tmp_path / 'bench'
    directory.mkdir()
    # Its topics are those of a robot; other tests and robots are in other domains.
    env = {**os.environ, 'ROS_DOMAIN_ID': str(1 + os.getpid() % 100)}
    run_page(TUTORIAL.read_text(encoding='utf-8'), directory, env, 110.0)
