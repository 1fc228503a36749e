# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `driver` node: from the serial port to `frames` and other topics."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Event, Thread
from typing import Any

import rclpy
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.lifecycle import Node as LifecycleNode
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import (
    to_camera_info,
    to_depth_image,
    to_frame_msg,
    to_point_cloud,
    to_signal_image,
)
from retrolidar_ros.nodes.diagnostics import WARN, DiagnosticsPublisher, Health, ProblemLog
from retrolidar_ros.nodes.driver_health import DetectorWatch, DriverTally
from retrolidar_ros.nodes.parameters import Parameters, check_frame_id
from retrolidar_ros.nodes.qos import FRAME_QOS, STREAM, publisher
from retrolidar_ros.sensor.clock import ClockMap
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import Command
from retrolidar_ros.sensor.serial_source import PROTOCOLS, SerialSource

FrameCallback = Callable[[Frame, str], None]  # takes a stamped frame and its TF frame

_PATIENCE_S = 1.0  # for an answer: a sensor needs a frame period, the thread 0.2 s
_DONE = {
    Command.START: 'the sensor is ranging',
    Command.STOP: 'the sensor is stopped',
    Command.RESET: 'the sensor restarts',
}
_GRACE = 6  # examinations, one a second, until a problem is logged: a sensor takes time to start
_COUNT_PERIOD_FRAMES = 5  # subscribers are counted once in so many frames: that is slow


class FrameTopics:
    """The topics `frames`, `points`, `signal_image`, and those of a depth camera (REP 118)."""

    def __init__(self, node: Node, frame_id: str) -> None:
        self._frame_id = frame_id
        self._frames = 0
        self._subscribed: list[tuple[Any, Callable[..., Any]]] = []
        self._topics: list[tuple[Any, Callable[..., Any]]] = [
            (publisher(node, FrameMsg, 'frames', FRAME_QOS), to_frame_msg),
            (publisher(node, PointCloud2, 'points', STREAM), to_point_cloud),
            (publisher(node, Image, 'signal_image', STREAM), to_signal_image),
            (publisher(node, Image, 'depth/image_raw', STREAM), to_depth_image),
            (publisher(node, CameraInfo, 'depth/camera_info', STREAM), to_camera_info),
        ]

    def publish(self, frame: Frame) -> None:
        """Publish a frame, stamped in ROS time, on all topics with subscribers."""
        if self._frames % _COUNT_PERIOD_FRAMES == 0:
            self._subscribed = [one for one in self._topics if one[0].get_subscription_count()]
        self._frames += 1
        for topic, convert in self._subscribed:
            topic.publish(convert(frame, self._frame_id))


class DriverNode(LifecycleNode):
    """Publishes the sensor's frames with the time of their exposure.

    Configured, it reads the port in a thread of its own, so nothing delays a frame; active, it
    publishes.
    """

    def __init__(
        self,
        on_frame: FrameCallback | None = None,
        board: DiagnosticsPublisher | None = None,
        **options: Any,
    ) -> None:
        """Declare parameters, and start with autostart; `on_frame` gets frames without a topic."""
        # Set before super().__init__(): if that raises, rclpy calls destroy_node(), which needs
        # these.
        self._source: SerialSource | None = None
        self._thread: Thread | None = None
        self._stop = Event()
        self._is_active = self._is_finalized = self.failed = False
        super().__init__('driver', **options)
        self._on_frame = on_frame
        # rclpy makes the lifecycle services itself, so they can only be wrapped here.
        for service in self.services:
            if service.srv_name.endswith('/change_state'):
                service.callback = self._reject_invalid_transition(service.callback)
        parameters = Parameters(self, 'driver')
        self._values = parameters.values
        frame_id = self._values['frame_prefix'] + self._values['frame_id']
        self._frame_id = check_frame_id('frame_id', frame_id)
        self._topics = FrameTopics(self, self._frame_id)
        parameters.follow(self._change)
        self._clock_map = ClockMap(self._values['transport_delay'])
        self._tally = DriverTally()
        self._log, self._troubled = ProblemLog(self), 0
        for command in _DONE:
            self.create_service(Trigger, f'~/{command.value}', partial(self._serve, command))
        self._watch = None if on_frame else DetectorWatch(self)
        (board or DiagnosticsPublisher(self)).register_health_check(self, 'frames', self._examine)
        if self._values['autostart']:
            self.trigger_configure()
            self.trigger_activate()

    def _reject_invalid_transition(
        self, change_state: Callable[[Any, Any], Any]
    ) -> Callable[[Any, Any], Any]:
        """Return a service that refuses impossible transitions; rclpy's ends the node."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return change_state(request, response)
            except RuntimeError as error:
                self.get_logger().error(f'life cycle: {str(error).partition(", at /")[0]}')
                response.success = False
                return response

        return answer

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start reading the port, or waiting for it."""
        values = self._values
        self._clock_map = ClockMap(values['transport_delay'])
        self._source = SerialSource(
            values['serial_port'],
            values['serial_baud'],
            PROTOCOLS[values['protocol']](self._now_ns),
            self._now_ns,
        )
        self._tally = DriverTally()
        self._stop.clear()
        self._thread = Thread(target=self._read, args=(self._source,), daemon=True)
        self._thread.start()
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start publishing."""
        self._is_active = True
        return TransitionCallbackReturn.SUCCESS

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop publishing, but keep reading, to follow the sensor's clock."""
        self._is_active = False
        return TransitionCallbackReturn.SUCCESS

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the port."""
        self._end()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the port for good."""
        self._is_finalized = True
        self._end()
        return TransitionCallbackReturn.SUCCESS

    def stop(self) -> None:
        """Stop reading, without waiting for the thread."""
        self._stop.set()

    def destroy_node(self) -> None:
        """Close the port, then the node."""
        self._end()
        super().destroy_node()

    def _end(self) -> None:
        self._is_active = False
        self._stop.set()
        if self._thread is not None:
            self._thread.join()
        self._thread = self._source = None

    def _now_ns(self) -> int:
        """Return ROS time: with use_sim_time that of /clock, 0 until it ticks."""
        return int(self.get_clock().now().nanoseconds)

    def _change(self, values: dict[str, Any]) -> None:
        self._clock_map.set_min_delay(values['transport_delay'])
        self._values = values

    def _read(self, source: SerialSource) -> None:
        def report(line: str) -> None:
            # A separate call for each severity: a logger refuses two from one line.
            if source.is_open:
                self.get_logger().info(line)
            else:
                self.get_logger().warning(line)

        try:
            source.run(self._publish, report, self._stop)
        except Exception as error:
            # If another node of the process fails, the publisher becomes invalid.
            if rclpy.ok():
                self.failed = True
                self.get_logger().fatal(f'reading has failed: {error!r}')
                rclpy.try_shutdown()

    def _publish(self, frames: list[Frame], arrival_ns: int) -> None:
        if not arrival_ns:
            self._tally.count_untimed(len(frames))
            return
        arrived_ns = time.perf_counter_ns()
        for frame in frames:
            stamp_ns = self._clock_map.map(frame.sensor_time_us, arrival_ns)
            if stamp_ns < 0:  # exposed before the simulated clock started
                continue
            stamped = replace(frame, stamp_ns=stamp_ns)
            if self._is_active:
                self._topics.publish(stamped)
            # The ROS clock is read once a frame: a call takes as long as all else here.
            self._tally.count(stamped, arrival_ns - stamp_ns + time.perf_counter_ns() - arrived_ns)
            if self._is_active and self._watch is not None:
                self._watch.sent()
            if self._is_active and self._on_frame is not None:
                self._on_frame(stamped, self._frame_id)

    def _examine(self) -> Health:
        health = self._judge()
        # Why the port cannot be opened is logged where it is tried.
        is_open = self._source is not None and self._source.is_open
        self._troubled = self._troubled + 1 if is_open and health.problems else 0
        if self._troubled >= _GRACE:
            for _, text in health.problems:
                self._log.warn(text)
        return health

    def _judge(self) -> Health:
        source = self._source
        if self._is_finalized:
            return Health([(WARN, 'finalized: the node was shut down; start it again')], {})
        if source is None:
            return Health([(WARN, 'not configured: the port is closed')], {})
        health = self._tally.examine(source, self._clock_map)._replace(hardware_id=source.port)
        if (identity := source.identity) is not None:
            health.values['firmware'] = identity.version
            health = health._replace(hardware_id=identity.serial)
        if source.is_open and identity is not None and not identity.is_ranging:
            return health._replace(problems=[(WARN, 'the sensor is stopped: call ~/start')])
        if source.is_open and not self._is_active:
            problem = 'not active: frames are read and not published'
            return health._replace(problems=[(WARN, problem)])
        if self._watch is not None and (silent := self._watch.problem()):
            health.problems.append((WARN, silent))
        return health

    def _serve(
        self, command: Command, _: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        """Answer a service: that blocks the executor, but no frame, for a second at most."""
        problem = self._command(command)
        response.success, response.message = not problem, problem or _DONE[command]
        return response

    def _command(self, command: Command) -> str:
        """Send a command to the sensor; return why it has no effect, or ''."""
        if (source := self._source) is None:
            return 'not configured: the port is closed'
        if not source.is_open:
            return source.problem
        if source.reader.commands is None:
            return 'this protocol has no commands'
        try:
            is_done = source.reader.commands.ask(command, _PATIENCE_S)
        except TimeoutError as error:
            return f'{error}: flash a firmware that knows commands, such as firmware/reader'
        return '' if is_done else f'the sensor has not obeyed {command.value}'
