# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The task coffee, started node by node: what test/launch asserts of its launch file."""

from collections.abc import Iterator

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from harness import Sensor
from harness_observer import System, running
from harness_tasks import BASE_VIEW, SENSOR_VIEW, check_coffee, publish_base
from std_msgs.msg import Bool, String

from retrolidar_ros.nodes.conversion import from_pose, vector_of
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.settings.files import shared_file


@pytest.fixture(scope='module')
def coffee(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    """Start two nodes that wait for the same objects, one of them in another frame."""
    scene = load_scene('coffee')
    with running(tmp_path_factory.mktemp('coffee'), '/use_coffee') as system:
        publish_base(system)
        system.start('driver', serial_port=system.port)
        system.start('detector', marker_file=shared_file('config/markers.yaml'))
        system.start('coffee', max_stddev=0.2)
        system.start(
            'coffee',
            *('-r', f'markers:={system.namespace}/markers'),
            name='base coffee',
            namespace=f'{system.namespace}/base',
            max_stddev=0.2,
            target_frame=BASE_VIEW.frame,
        )
        node = system.node
        system.wait(lambda: node.count_subscribers('frames') > 1, 'the detector')
        system.wait(lambda: node.count_subscribers('markers') > 2, 'both nodes')
        nothing_seen = ', '.join(f'{one.name} has not been seen' for one in scene.markers)
        both = ('coffee', 'base/coffee')
        ready = [system.collect(Bool, f'{node}/ready') for node in both]
        missing = [system.collect(String, f'{node}/missing') for node in both]
        system.wait(lambda: all(ready + missing), 'what is missing')
        assert [[one.data for one in some] for some in ready] == [[False]] * 2
        assert [[one.data for one in some] for some in missing] == [[nothing_seen]] * 2
        with Sensor(scene, system.port):
            yield system


def test_coffee_is_ready_when_all_objects_are_placed(coffee: System) -> None:
    check_coffee(coffee, load_scene('coffee'), 'coffee', SENSOR_VIEW)
    assert ': all objects are placed' in coffee.log('coffee')


def test_coffee_places_objects_in_the_target_frame(coffee: System) -> None:
    views = coffee.collect(PoseStamped, 'base/coffee/next_view')
    check_coffee(coffee, load_scene('coffee'), 'base/coffee', BASE_VIEW)
    # A viewpoint comes with the next reading, which the demands above may not have waited for.
    coffee.services.set(f'{coffee.namespace}/base/coffee', max_stddev=0.01)
    coffee.wait(lambda: bool(views), 'a viewpoint')
    assert views[-1].header.frame_id == BASE_VIEW.frame
    reach_m = np.linalg.norm(vector_of(views[-1].pose.position) - BASE_VIEW.translation_m)
    assert reach_m == pytest.approx(0.5)
    # It looks at the objects, which are ahead.
    assert from_pose(views[-1].pose)[1][0, 2] > 0.8
