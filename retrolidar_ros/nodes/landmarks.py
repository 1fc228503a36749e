# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `landmarks` node: objects with markers in a fixed frame, or a robot among known ones."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.time import Time
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from tf2_ros import TransformBroadcaster
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.detector.parameters import known_markers
from retrolidar_ros.marker.known_markers import KnownMarker, objects_of, usual_id
from retrolidar_ros.nodes.conversion import Marked, to_header, to_pose_msg, to_transform
from retrolidar_ros.nodes.detection_subscriber import TransformedDetections
from retrolidar_ros.nodes.diagnostics import WARN, DiagnosticsPublisher, Health
from retrolidar_ros.nodes.parameters import NAME, Parameters, check_frame_id, child_frame_of
from retrolidar_ros.nodes.qos import LATCHED, STREAM, latched, publisher, topic_part, topics_of
from retrolidar_ros.nodes.run import repeat
from retrolidar_ros.nodes.transforms import TransformFinder
from retrolidar_ros.nodes.visualization import landmark_shapes
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, KnownPose, Reading
from retrolidar_ros.tasks.survey import Backlog, Batch, Survey
from retrolidar_ros.tasks.survey_files import check_target, load_survey, save_survey

# Every tick, readings are solved for so long: half a core at most. The others wait.
_TICK_S, _MAX_BUSY_S = 0.02, 0.01
_TOPICS_S = 1.0  # between shapes, and looks for frames with another parent
_MAX_WAIT_S = 0.3  # more is told


class LandmarkTopics:
    """Publishes landmarks in a fixed frame."""

    def __init__(
        self, node: Node, finder: TransformFinder, fixed_frame: str, child_frame: str, send: bool
    ) -> None:
        """Make the publishers; `send` transforms to `child_frame`, with a name for its NAME."""
        self._finder = finder
        self._node = node
        self._fixed = fixed_frame
        self._child_frame = child_frame
        self._poses: dict[str, Publisher] = {}
        self._taken: set[str] = set()  # frames that have another parent
        self._broadcaster = TransformBroadcaster(node) if send else None
        self._shapes = publisher(node, MarkerArray, '~/marker_array', LATCHED)
        self.shapes_due = False  # whether landmarks have changed since their shapes were sent

    def publish(self, estimate: Estimate) -> None:
        """Publish the pose of a landmark, and its transform."""
        name = estimate.name
        header = to_header(round(max(estimate.stamp_s, 0.0) * 1e9), self._fixed)
        if name not in self._poses:
            topic = f'~/objects/{topic_part(name)}'
            self._poses[name] = latched(self._node, PoseWithCovarianceStamped, topic)
            deviation_mm = 1e3 * estimate.stddev_m
            self._node.get_logger().info(f'{name} is placed, to ±{deviation_mm:.0f} mm so far')
            self._check_frames()
        message = to_pose_msg(header, estimate.position_m, estimate.rotation, estimate.covariance)
        self._poses[name].publish(message)
        self.shapes_due = True
        child = self._frame_of(name)
        if self._broadcaster is not None and child not in self._taken:
            self._broadcaster.sendTransform([to_transform(header, child, message.pose.pose)])

    def _frame_of(self, name: str) -> str:
        return self._child_frame.replace(NAME, name)

    def _check_frames(self) -> None:
        """Stop sending frames to which another node gives another parent."""
        parents = self._finder.parents()
        for child in map(self._frame_of, self._poses):
            parent = parents.get(child, self._fixed)
            if self._broadcaster is not None and parent != self._fixed and child not in self._taken:
                self._taken.add(child)
                self._node.get_logger().error(
                    f'no transform from {self._fixed} to {child} is sent: its parent in TF is '
                    f'{parent}, by another node; set child_frame'
                )

    def forget(self) -> None:
        """Forget all landmarks: their latched poses, too, and whose frames others send."""
        for pose in self._poses.values():
            self._node.destroy_publisher(pose)
        self._poses.clear()
        self._taken.clear()
        self.shapes_due = True

    def update(self, estimates: Sequence[Estimate]) -> None:
        """Check frames, and publish the shapes of all landmarks if any changed; once a second."""
        self._check_frames()
        if self.shapes_due and self._shapes.get_subscription_count():
            self.shapes_due = False
            stamp = self._node.get_clock().now().to_msg()
            shapes = landmark_shapes(Header(stamp=stamp, frame_id=self._fixed), estimates)
            self._shapes.publish(MarkerArray(markers=shapes))


class LandmarksNode(Node):
    """Publishes the poses of objects, or the robot's among them."""

    def __init__(self) -> None:
        super().__init__('landmarks')
        self._values = values = Parameters(self, 'landmarks').values
        self._fixed = check_frame_id('fixed_frame', values['fixed_frame'])
        markers = known_markers(values)
        objects = objects_of(markers)
        self._names = {marker.id: marker.object or marker.frame for marker in markers.values()}
        errors = Errors(
            range_bias_m=values['range_bias'],
            pose_m=values['pose_stddev'],
            turn_rad=values['turn_stddev'],
            acceleration=values['acceleration'],
        )
        frame, known = self._load(values['load_file'])
        if values['save_file']:
            try:
                check_target(Path(values['save_file']))
            except ValueError as error:
                raise ValueError(f'save_file: {error}') from error
        self._objects = objects
        self._owners = _owners({*known, *objects})
        self._survey = Survey(objects, errors, {} if values['localize'] else known)
        self._room = None
        if values['localize']:
            usual = [KnownMarker(one) for name in known if (one := usual_id(name)) is not None]
            lone = (one for one in (*usual, *markers.values()) if not one.object)
            alone: dict[str, dict[int, Floats]] = {one.frame: {one.id: np.zeros(3)} for one in lone}
            self._room = room_of(known, alone | objects, errors, flat=values['flat'])
            self._pose = publisher(self, PoseWithCovarianceStamped, '~/pose', STREAM)
        elif known and frame != self._fixed:
            raise ValueError(f'load_file: its landmarks are in {frame}, not in {self._fixed}')
        self._known_frame = frame
        self._backlog = Backlog()
        self._longest_s = 0.0
        self._dropped = 0
        self.create_service(Trigger, '~/save', self._save)
        self.create_service(Trigger, '~/forget', self._forget)
        DiagnosticsPublisher(self).register_health_check(self, 'landmarks', self._examine)
        self._readings = TransformedDetections(
            self, self._fixed, values['patience'], self._on_reading, self._restart, values['topics']
        )
        self._topics = LandmarkTopics(
            self, self._readings.finder, self._fixed, child_frame_of(values), values['publish_tf']
        )
        for estimate in self._survey.estimates():
            self._topics.publish(estimate)
        aim = f'placing markers in {self._fixed}'
        if values['localize']:
            aim = f'locating {values["base_frame"]} in {frame}'
        self.get_logger().info(aim)
        repeat(self, _TICK_S, self._solve)
        repeat(self, _TOPICS_S, lambda: self._topics.update(self._survey.estimates()))

    def _load(self, path: str) -> tuple[str, dict[str, KnownPose]]:
        if not path:
            return self._fixed, {}
        try:
            return load_survey(Path(path))
        except (OSError, ValueError) as error:
            raise ValueError(f'load_file: {error}') from error

    def _on_reading(self, reading: Reading, message: Marked) -> None:
        name = 'room'
        if self._room is None:
            # Each of several sensors may have a name of its own for a marker.
            own = message.child_frame_id.removeprefix(self._values['frame_prefix'])
            name = self._names.get(reading.marker, own)
        elif not self._room.has(reading.marker):
            return
        self._backlog.add(name, reading, time.monotonic())

    def _solve(self) -> None:
        """Solve and publish what waits, for as long as it may take in a tick."""
        # Processor time: on a busy machine wall time would be too long.
        began_s = time.thread_time()
        while self._backlog and time.thread_time() < began_s + _MAX_BUSY_S:
            batch = self._backlog.pop()
            try:
                if self._room is None:
                    self._update_landmark(batch)
                else:
                    self._localize(self._room, batch)
            except ValueError as error:
                self._readings.refuse(str(error))
            self._longest_s = max(self._longest_s, time.monotonic() - batch.since_s)

    def _update_landmark(self, batch: Batch) -> None:
        """Publish a landmark with new readings; ValueError if they cannot be used."""
        topic = f'~/objects/{topic_part(batch.name)}'
        owner = self._owners.get(topic, batch.name)
        if owner != batch.name:
            raise ValueError(f'two names would share a topic, rename one: {owner}, {batch.name}')
        estimate = self._survey.take(batch.name, *batch.readings).estimate()
        self._owners[topic] = batch.name
        if estimate is not None:
            self._topics.publish(estimate)

    def _localize(self, room: Landmark, batch: Batch) -> None:
        """Publish the pose of the base at the time of the newest reading; ValueError likewise."""
        inliers = room.take(*batch.readings)
        if not inliers:
            return
        estimate, base = room.estimate(), self._values['base_frame']
        stamp = Time(nanoseconds=round(max(reading.stamp_s for reading in inliers) * 1e9))
        found = self._readings.finder.find(self._fixed, base, stamp)
        if found is None:
            self.get_logger().warning(
                f'no transform from {base} to {self._fixed}', throttle_duration_sec=5.0
            )
        elif estimate is not None and (pose := robot_pose(estimate, *found)) is not None:
            header = Header(stamp=stamp.to_msg(), frame_id=self._known_frame)
            self._pose.publish(to_pose_msg(header, *pose))

    def _save(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        path = self._values['save_file']
        try:
            if not path:
                raise ValueError('save_file is empty')
            if self._room is not None:
                raise ValueError('while localising no map is made')
            response.message = save_survey(Path(path), self._fixed, self._survey.estimates())
            response.success = True
            self.get_logger().info(response.message)
        except (OSError, ValueError) as error:
            name = 'save_file: ' if isinstance(error, OSError) else ''
            response.message = f'nothing was saved: {name}{error}'
            self.get_logger().error(response.message)
        return response

    def _forget(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._restart()
        response.success = True
        response.message = 'the pose is forgotten; the landmarks of load_file stay'
        if self._room is None:
            self._survey.forget()
            self._topics.forget()
            self._owners = _owners(self._objects)
            response.message = 'all landmarks are forgotten; files stay'
        return response

    def _restart(self) -> None:
        """Begin again: time has jumped back."""
        self._backlog.clear()
        self._survey.restart()
        if self._room is not None:
            self._room.restart()
        self._topics.shapes_due = True

    def _examine(self) -> Health:
        values = {}
        rows = self._survey.estimates()
        if self._room is not None:
            rows = [room for room in [self._room.estimate()] if room is not None]
        for estimate in rows:
            values[f'{estimate.name}: readings'] = str(estimate.readings)
            values[f'{estimate.name}: rejected'] = str(estimate.rejected)
            values[f'{estimate.name}: baseline [m]'] = f'{estimate.baseline_m:.3f}'
            values[f'{estimate.name}: deviation [m]'] = f'{estimate.stddev_m:.4f}'
            if estimate.moved_s is not None:
                values[f'{estimate.name}: last moved [s]'] = f'{estimate.moved_s:.1f}'
        problems = self._readings.examine(values)
        values['backlog'] = str(len(self._backlog))
        values['longest wait [s]'] = f'{self._longest_s:.3f}'
        values['dropped without time'] = str(self._backlog.dropped)
        dropped, self._dropped = self._backlog.dropped - self._dropped, self._backlog.dropped
        if dropped or self._longest_s > _MAX_WAIT_S:
            text = f'too many readings: they wait up to {self._longest_s:.1f} s, {dropped} dropped'
            problems.append((WARN, text))
        self._longest_s = 0.0
        if not rows:
            problems.append((WARN, 'nothing is placed yet'))
        return Health(problems, values, f'{len(rows)} placed')


def _owners(names: Iterable[str]) -> dict[str, str]:
    """Return names by their topics; ValueError if two would share one."""
    return {topic: name for name, topic in topics_of('~/objects/', sorted(names)).items()}
