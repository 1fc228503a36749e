# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `landmarks` node: objects with markers in a fixed frame, or a robot among known ones."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.time import Time
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.detector.parameters import known_markers
from retrolidar_ros.marker.known_markers import objects_of
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import to_header, to_pose_msg, to_transform
from retrolidar_ros.nodes.diagnostics import OK, WARN, Health, publish_health
from retrolidar_ros.nodes.parameters import Parameters, check_frame_id
from retrolidar_ros.nodes.placed_readings import PlacedReadings
from retrolidar_ros.nodes.qos import LATCHED, STREAM, publisher, topic_part
from retrolidar_ros.nodes.run import run
from retrolidar_ros.nodes.track_topics import SOURCES
from retrolidar_ros.nodes.transforms import transform_sender
from retrolidar_ros.nodes.visualization import landmark_shapes
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.section import ConfigError
from retrolidar_ros.settings.yaml_files import load_yaml
from retrolidar_ros.tasks.landmarks import Estimate
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, Reading
from retrolidar_ros.tasks.state import Prior
from retrolidar_ros.tasks.survey import Survey, parse_survey, survey_content


class LandmarksNode(Node):
    """Publishes the poses of objects, or the robot's among them."""

    def __init__(self) -> None:
        """Declare parameters, load known landmarks, and subscribe."""
        super().__init__('landmarks')
        parameters = Parameters(self, 'landmarks')
        _declare(parameters)
        self._values = values = parameters.values
        if values['source'] == 'tracks' and 'markers' in values['topics']:
            raise ValueError('topics: markers are detections; name topics of tracks, or no source')
        self._fixed = check_frame_id('fixed_frame', values['fixed_frame'])
        markers = known_markers(values)
        objects: dict[str, dict[int, Floats]] = {
            name: {one: np.array(place) for one, place in places.items()}
            for name, places in objects_of(markers).items()
        }
        self._names = {one.id: one.frame for one in markers.values()}
        errors = Errors(
            range_bias_m=values['range_bias'],
            pose_m=values['pose_stddev'],
            turn_rad=values['turn_stddev'],
            acceleration=values['acceleration'],
        )
        frame, known = self._load(values['load_file'])
        self._survey = Survey(objects, errors, known)
        self._room = None
        if values['localize']:
            alone: dict[str, dict[int, Floats]] = {
                name: {int(name.removeprefix('marker_')): np.zeros(3)}
                for name in known
                if re.fullmatch(r'marker_\d+', name)
            }
            for one in markers.values():
                if not one.object:
                    alone[one.frame] = {one.id: np.zeros(3)}
            self._room = room_of(known, alone | objects, errors, flat=values['flat'])
            self._pose = publisher(self, PoseWithCovarianceStamped, '~/pose', STREAM)
        elif known and frame != self._fixed:
            raise ValueError(f'load_file: its landmarks are in {frame}, not in {self._fixed}')
        self._known_frame = frame
        self._poses: dict[str, Publisher] = {}
        self._blocked: set[str] = set()
        self._sent: set[str] = set()
        self._send = transform_sender(self)
        self._shapes = publisher(self, MarkerArray, '~/marker_array', LATCHED)
        self.create_service(Trigger, '~/save', self._save)
        self.create_service(Trigger, '~/forget', self._forget)
        publish_health(self, 'landmarks', '', self._examine)
        self._readings = PlacedReadings(
            self,
            values['topics'],
            values['source'],
            self._fixed,
            values['patience'],
            self._take,
            self._survey.forget,
        )
        parameters.warn_of_unknown()
        for estimate in [] if values['localize'] else self._survey.estimates():
            self._publish(estimate)

    def _load(self, path: str) -> tuple[str, dict[str, Prior]]:
        if not path:
            return self._fixed, {}
        try:
            return parse_survey(load_yaml(Path(path)))
        except (OSError, ConfigError) as error:
            raise ValueError(f'load_file: {path}: {error}') from error

    def _take(self, reading: Reading, message: MarkerDetection | MarkerTrack) -> None:
        if self._room is not None:
            if self._room.has(reading.marker) and self._room.take(reading):
                self._localize(message.header.stamp)
            return
        # Each of several sensors may have a name of its own for a marker.
        name = self._names.get(reading.marker, message.child_frame_id)
        estimate = self._survey.take(reading, name).estimate()
        if estimate is not None:
            self._publish(estimate)

    def _localize(self, stamp: Any) -> None:
        """Publish the pose of the base at the time of a reading."""
        assert self._room is not None
        room = self._room.estimate()
        base = self._values['base_frame']
        found = self._readings.finder.find(self._fixed, base, Time.from_msg(stamp))
        if found is None:
            self.get_logger().warning(
                f'no transform from {base} to {self._fixed}', throttle_duration_sec=5.0
            )
        elif room is not None and (pose := robot_pose(room, *found)) is not None:
            header = Header(stamp=stamp, frame_id=self._known_frame)
            self._pose.publish(to_pose_msg(header, *pose))

    def _publish(self, estimate: Estimate) -> None:
        """Publish a landmark."""
        name = estimate.name
        header = to_header(round(max(estimate.stamp_s, 0.0) * 1e9), self._fixed)
        if name not in self._poses:
            topic = f'~/objects/{topic_part(name)}'
            self._poses[name] = self.create_publisher(PoseWithCovarianceStamped, topic, LATCHED)
        message = to_pose_msg(header, estimate.position_m, estimate.rotation, estimate.covariance)
        self._poses[name].publish(message)
        self._shapes.publish(MarkerArray(markers=landmark_shapes(header, self._survey.estimates())))
        if self._values['publish_tf']:
            self._send_transform(name, message)

    def _send_transform(self, name: str, message: PoseWithCovarianceStamped) -> None:
        child = self._values['child_frame'].replace('{name}', name)
        if child in self._blocked:
            return
        if child not in self._sent and self._readings.finder.knows(child):
            self._blocked.add(child)
            self.get_logger().warning(
                f'{child} has a parent in TF already, so it is not sent; set child_frame, or '
                'publish_tf of the detector to false'
            )
            return
        self._sent.add(child)
        self._send([to_transform(message.header, child, message.pose.pose)])

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        path = self._values['save_file']
        content = survey_content(self._fixed, self._survey.estimates())
        try:
            if not path:
                raise OSError('save_file is empty')
            text = yaml.safe_dump(content, sort_keys=False, default_flow_style=None)
            Path(path).write_text(text, encoding='utf-8')
        except OSError as error:
            response.message = str(error)
            return response
        response.success = True
        response.message = f'{len(content["landmarks"])} landmarks in {path}'
        return response

    def _forget(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._survey.forget()
        if self._room is not None:
            self._room.forget()
        response.success = True
        return response

    def _examine(self) -> Health:
        values = {}
        rows = self._survey.estimates()
        if self._room is not None:
            rows = [room for room in [self._room.estimate()] if room is not None]
        for one in rows:
            values[f'{one.name}: readings'] = str(one.readings)
            values[f'{one.name}: rejected'] = str(one.rejected)
            values[f'{one.name}: baseline [m]'] = f'{one.baseline_m:.3f}'
            values[f'{one.name}: deviation [m]'] = f'{one.stddev_m:.4f}'
            if one.moved_s is not None:
                values[f'{one.name}: last moved [s]'] = f'{one.moved_s:.1f}'
        for reason, count in self._readings.dropped.items():
            values[f'dropped: {reason}'] = str(count)
        if not rows:
            return Health(WARN, 'nothing is placed yet', values)
        return Health(OK, f'{len(rows)} placed', values)


def _declare(parameters: Parameters) -> None:
    declare = parameters.declare
    declare('source', 'What readings are made of.', among=SOURCES)
    declare('topics', 'Topics of the source.')
    declare('fixed_frame', 'Frame of the landmarks; TF must connect the sensors to it.')
    declare('marker_file', 'YAML file of the known markers, for objects with several.')
    declare('load_file', 'Landmarks written by ~/save; empty = none.')
    declare('save_file', 'Where ~/save writes; empty = nowhere.')
    declare('publish_tf', 'Send a transform for every landmark.')
    declare('child_frame', 'TF frame of a landmark; {name} stands for its name.')
    declare('patience', 'Longest wait for a transform [s].', 0.0, 60.0)
    declare('range_bias', "Standard deviation of a sensor's range bias [m].", 0.0, 1.0)
    declare('pose_stddev', "Standard deviation of the sensor's position in TF [m].", 0.0, 1.0)
    declare('turn_stddev', "Standard deviation of the sensor's rotation in TF [rad].", 0.0, 1.0)
    declare(
        'acceleration', 'Standard deviation for moving landmarks [m/s²]; 0 = static.', 0.0, 100.0
    )
    declare('localize', 'Locate base_frame among the landmarks of load_file.')
    declare('flat', 'The robot moves on a floor: its frames are level with load_file.')
    declare('base_frame', 'Frame of the robot that is localised.')


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(LandmarksNode)
