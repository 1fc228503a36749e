# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What detectors report of frames and candidates that are not as they expect."""

import re
from collections.abc import Iterator
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from harness_nodes import System, running
from harness_observer import values_of

from retrolidar_ros.detector.likelihood_detector import Reason

FRAMES = ('-r', 'frames:=/reports/frames')


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    """Give three detectors the frames of one sensor."""
    with running(tmp_path_factory.mktemp('reports'), '/reports') as system:
        system.start('detector')
        system.start('detector', *FRAMES, name='fast', namespace='/fast', bit_period=0.015)
        debug = ('--log-level', 'debug')
        given: dict[str, Any] = {'name': 'slow', 'namespace': '/slow', 'bit_period': 0.084}
        system.start('detector', *FRAMES, *debug, **given)
        system.wait(lambda: system.node.count_subscribers('frames') == 4, 'all detectors')
        with system.fed('/reports/frames'):
            yield system


def test_a_marker_of_other_bits_is_reported_for_as_long_as_it_blinks(system: System) -> None:
    for _ in range(2):
        status = system.wait_for_status(
            '/slow/detector: markers', DiagnosticStatus.WARN, 'is read with bits of'
        )
        assert re.search(
            r'with bits of 4[12]\.\d ms, not of 84.0 ms: set bit_period to 0.04', status.message
        )


def test_frames_that_do_not_suit_the_bits_are_warned_of_once(system: System) -> None:
    name = '/fast/detector: markers'
    system.wait(lambda: int(values_of(system.next_status(name))['frames']) > 50, 'frames')
    (line,) = (line for line in system.log('fast').splitlines() if 'a frame comes every' in line)
    assert 'WARN' in line
    assert re.search(r'a frame comes every 2[01]\.\d ms, but bit_period is 15\.0 ms', line)


def test_every_candidate_that_is_rejected_is_logged_for_debugging(system: System) -> None:
    def counted() -> int:
        values = values_of(system.next_status('/slow/detector: markers'))
        return sum(int(count) for key, count in values.items() if 'rejected' in key)

    system.wait(lambda: counted() > 0, 'a refusal')
    reasons = '|'.join(reason.value for reason in Reason)
    rejected = rf'rejected: ({reasons}): ID \d+, evidence \S+, word \S+, margin \S+ nats'
    expected = counted()
    assert len(re.findall(rejected, system.log('slow'))) >= expected > 0


def test_readings_with_which_too_few_agree_are_counted_and_not_published(system: System) -> None:
    name = 'detector: markers'
    system.services.set(f'{system.namespace}/detector', min_readings=100)
    system.markers.clear()

    def withheld() -> int:
        return int(values_of(system.next_status(name))['withheld by min_readings'])

    system.wait(lambda: withheld() > 2, 'readings')
    assert not system.markers
    system.services.set(f'{system.namespace}/detector', min_readings=1)
    system.wait(lambda: bool(system.markers), 'a reading')
    assert withheld() == 0
