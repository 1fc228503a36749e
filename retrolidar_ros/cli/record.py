# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Record a sensor into a bag, without ROS: the frames that the driver would have published."""

import argparse
import math
import shutil
import sys
import time
from dataclasses import replace
from functools import partial

from retrolidar_ros.bag import FrameWriter
from retrolidar_ros.cli.arguments import add_port, add_storage, output_path, seconds
from retrolidar_ros.detector.blinking_zones import blinking_zones
from retrolidar_ros.detector.frame_monitor import FrameMonitor
from retrolidar_ros.sensor.clock import ClockMap
from retrolidar_ros.sensor.frame import Recording, ZoneGrid
from retrolidar_ros.sensor.model import NoiseLaw
from retrolidar_ros.sensor.serial_source import PROTOCOLS, SerialSource, in_background
from retrolidar_ros.settings.interrupts import termination_noted
from retrolidar_ros.settings.parameter import declared

HELP = 'record a sensor into a bag, without ROS'
DESCRIPTION = (
    'Ctrl-C ends the recording and completes the bag. Waits while the sensor is unplugged. Exit '
    'code 1 if no frame came.'
)
_PROGRESS_S = 1.0


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_port(command)
    command.add_argument(
        '-o', '--output', type=output_path, required=True, metavar='BAG', help='directory to create'
    )
    add_storage(command)
    command.add_argument('--duration', type=seconds, metavar='S', help='end after this time [s]')


def summary(monitor: FrameMonitor, elapsed_s: float, rate_hz: float, silence: str) -> str:
    """Return counts of frames, and which zone blinks most or why no frames come, in a line."""
    text = f'{elapsed_s:4.0f} s: {monitor.frames} frames, {rate_hz:.1f} a second'
    text += f', {monitor.lost} lost'
    if not rate_hz:
        return f'{text}; {silence}'
    if len(monitor.newest) < 2:
        return text
    recording = Recording.of(list(monitor.newest))
    if not (zones := blinking_zones(recording, NoiseLaw().lit(recording.ambient))):
        return f'{text}; no zone blinks'
    return f'{text}; zone {zones[0].zone} blinks by {zones[0].modulation_db:.0f} dB'


def run(arguments: argparse.Namespace) -> int:
    """Record until Ctrl-C or the end of the duration."""
    driver = declared()['driver']
    reader = PROTOCOLS[arguments.protocol](time.time_ns)
    source = SerialSource(arguments.port, arguments.baud, reader)
    clock = ClockMap(driver['transport_delay'].default)
    monitor = FrameMonitor(ZoneGrid())
    counted = 0
    writer = FrameWriter(arguments.output, arguments.storage, frame_id=driver['frame_id'].default)
    begin_s = time.monotonic()
    end_s = begin_s + (arguments.duration or math.inf)
    due_s = begin_s + _PROGRESS_S
    received = source.received
    say = partial(print, file=sys.stderr, flush=True)
    with termination_noted() as requested, writer as bag, in_background(source, say) as take_until:
        while (now_s := time.monotonic()) < end_s and not requested.is_set():
            if now_s >= due_s:
                rate_hz = (monitor.frames - counted) / (_PROGRESS_S + now_s - due_s)
                received, before = source.received, received
                problem = source.problem or received.silence(before)
                say(summary(monitor, now_s - begin_s, rate_hz, problem))
                counted, due_s = monitor.frames, now_s + _PROGRESS_S
            frames, arrival_ns = take_until(min(due_s, end_s)) or ([], 0)
            for frame in frames:
                stamp_ns = clock.map(frame.sensor_time_us, arrival_ns)
                bag.write(replace(frame, stamp_ns=stamp_ns), arrival_ns)
                if monitor.newest and monitor.newest[-1].grid != frame.grid:
                    monitor.restart(frame.grid)
                monitor.take(frame)
    if not monitor.frames:
        shutil.rmtree(arguments.output)
        print(f'no frame came; {arguments.output} was not kept')
        return 1
    print(f'{monitor.frames} frames, {monitor.lost} lost, in {arguments.output}')
    return 0
