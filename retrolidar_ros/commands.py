# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the subcommands of `retrolidar` do. What one needs is imported when it runs.

Each takes the parsed arguments and returns the exit code.
"""

from __future__ import annotations

import argparse
import json
import sys
from contextlib import suppress
from pathlib import Path

from retrolidar_ros.bag import BagError


def demo(arguments: argparse.Namespace) -> int:
    """Run a scene, and compare what was read with the truth."""
    from retrolidar_ros.demo import run_demo

    return run_demo(arguments.scene, arguments.output, arguments.timeout)


def emulate(arguments: argparse.Namespace) -> int:
    """Be a sensor at a serial port, or write a bag."""
    from retrolidar_ros.emulator import emulate, record
    from retrolidar_ros.interrupts import interrupted_once
    from retrolidar_ros.yaml_files import load_scene

    scene = load_scene(arguments.scene)
    if arguments.bag is not None:
        duration_s = scene.duration_s if arguments.duration is None else arguments.duration
        frames = record(scene, arguments.bag, arguments.storage, duration_s)
        print(f'{frames} frames of {duration_s:g} s in {arguments.bag}')
        return 0

    def say_ready() -> None:
        print(f'a sensor is at {arguments.port_link}; Ctrl-C unplugs it', flush=True)

    with interrupted_once():
        sent, lost = emulate(scene, arguments.port_link, arguments.duration, say_ready)
    print(f'{sent} frames sent, {lost} found no listener')
    return 0


def watch(arguments: argparse.Namespace) -> int:
    """Show live what a sensor sees."""
    from retrolidar_ros.interrupts import interrupted_once
    from retrolidar_ros.watch import watch

    with suppress(KeyboardInterrupt), interrupted_once():
        frames = watch(
            arguments.port,
            sys.stdout,
            baud=arguments.baud,
            protocol=arguments.protocol,
            zone=arguments.zone,
            bit_period_s=arguments.bit_period,
            duration_s=arguments.duration,
        )
        return 0 if frames else 1
    return 0


def decode(arguments: argparse.Namespace) -> int:
    """Print what is read in a bag."""
    from retrolidar_ros.bag import read_frames
    from retrolidar_ros.decoding import TEXT_HEADER, detect, to_json, to_text

    detections = detect(read_frames(arguments.bag, arguments.topic), arguments.method)
    for index, detection in enumerate(detections):
        if index == 0 and not arguments.json:
            print(TEXT_HEADER)
        print(to_json(detection) if arguments.json else to_text(detection))
    return 0


def plot(arguments: argparse.Namespace) -> int:
    """Draw what is read in a bag."""
    from retrolidar_ros.bag import read_frames
    from retrolidar_ros.decoding import detect
    from retrolidar_ros.frame import Frame, Recording
    from retrolidar_ros.plot import Reading, plot_readings

    frames: list[Frame] = []
    damage = None
    try:
        frames.extend(read_frames(arguments.bag, arguments.topic))
    except BagError as error:
        if not frames:
            raise
        damage = error
    origin_ns = frames[0].stamp_ns
    readings = [Reading.of(detection, origin_ns) for detection in detect(frames, arguments.method)]
    plot_readings(
        Recording.of(frames),
        readings,
        arguments.output,
        origin_ns=origin_ns,
        title=f'{arguments.bag.name}: {len(frames)} frames, {len(readings)} readings',
    )
    print(f'{arguments.output}: {len(frames)} frames, {len(readings)} readings')
    if damage is not None:
        raise damage
    return 0


def evaluate(arguments: argparse.Namespace) -> int:
    """Run experiments, or list them."""
    from retrolidar_ros.evaluation.experiments import EXPERIMENTS, run_experiments
    from retrolidar_ros.evaluation.page import write_page

    if not arguments.names and not arguments.all:
        for name, experiment in EXPERIMENTS.items():
            print(f'{name:16}{experiment.TITLE:44}{experiment.SOURCE}'.rstrip())
        return 0
    # A quick look is not to take the place of the report that stands in the repository.
    output = arguments.output or Path('report_quick' if arguments.quick else 'docs/report')
    names = list(EXPERIMENTS) if arguments.all else arguments.names
    run_experiments(names, output, quick=arguments.quick, seed=arguments.seed)
    print(f'{write_page(output) if arguments.all else output}')
    return 0


def ids(arguments: argparse.Namespace) -> int:
    """Choose IDs, or check them."""
    from retrolidar_ros.code import RESERVED_IDS
    from retrolidar_ros.dictionary import SAFE_DISTANCE, choose_ids, confusable_pairs, distances

    if arguments.count is not None:
        ids, least = choose_ids(arguments.count, arguments.min_distance)
        print(*ids, sep='\n')
        print(f'IDs: {len(ids)}, least distance: {least} bits', file=sys.stderr)
        return 0

    limit = SAFE_DISTANCE if arguments.min_distance is None else arguments.min_distance
    pairs = confusable_pairs(arguments.check, limit)
    reserved = sorted(set(arguments.check) & set(RESERVED_IDS))
    least = int(distances(arguments.check).min())
    print(f'IDs: {len(arguments.check)}, least distance: {least} bits')
    for marker_id in reserved:
        print(f'{marker_id} is reserved: after the preamble it never changes')
    for first, second, distance, shift in pairs:
        if distance == 0:
            print(f'{first} is there more than once')
        else:
            other = 'itself' if second == first else second
            print(f'{first} read from bit {shift} differs from {other} in {distance} bits')
    return 1 if reserved or pairs else 0


def budget(arguments: argparse.Namespace) -> int:
    """Print what to expect of a marker."""
    from retrolidar_ros.marker_budget import budget, parse_case, to_json, to_text

    case = parse_case(
        arguments.size, arguments.yaw, arguments.distance, arguments.cell, arguments.queries
    )
    found = budget(case)
    print(json.dumps(to_json(found)) if arguments.json else to_text(found))
    return 0
