# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `retrolidar` command. What a subcommand needs is imported when it runs."""

from __future__ import annotations

import argparse
import json
import os
import sys
from contextlib import suppress
from pathlib import Path

# Many threads make the detector's small matrix products slower. numpy reads this once, when it is
# imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from retrolidar_ros.bag import FRAMES_TOPIC, STORAGES, BagError
from retrolidar_ros.code import BIT_PERIOD_LIMITS_S, BIT_PERIOD_S
from retrolidar_ros.detector import METHODS
from retrolidar_ros.frame import ZONE_SHAPES
from retrolidar_ros.protocols import PROTOCOLS
from retrolidar_ros.section import ConfigError


def _demo(arguments: argparse.Namespace) -> int:
    from retrolidar_ros.demo import run_demo

    return run_demo(arguments.scene, arguments.output, arguments.timeout)


def _emulate(arguments: argparse.Namespace) -> int:
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


def _watch(arguments: argparse.Namespace) -> int:
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


def _decode(arguments: argparse.Namespace) -> int:
    from retrolidar_ros.bag import read_frames
    from retrolidar_ros.decoding import TEXT_HEADER, detect, to_json, to_text

    detections = detect(read_frames(arguments.bag, arguments.topic), arguments.method)
    for index, detection in enumerate(detections):
        if index == 0 and not arguments.json:
            print(TEXT_HEADER)
        print(to_json(detection) if arguments.json else to_text(detection))
    return 0


def _plot(arguments: argparse.Namespace) -> int:
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


def _evaluate(arguments: argparse.Namespace) -> int:
    from retrolidar_ros.evaluation import EXPERIMENTS, run_experiments, write_page

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


def _ids(arguments: argparse.Namespace) -> int:
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


def _budget(arguments: argparse.Namespace) -> int:
    from retrolidar_ros.marker_budget import budget, parse_case, to_json, to_text

    case = parse_case(
        arguments.size, arguments.yaw, arguments.distance, arguments.cell, arguments.queries
    )
    found = budget(case)
    print(json.dumps(to_json(found)) if arguments.json else to_text(found))
    return 0


def marker_ids(text: str) -> list[int]:
    """Parse IDs between commas."""
    try:
        return [int(part) for part in text.split(',')]
    except ValueError:
        message = f'{text!r} is no list of IDs such as 3,17,42'
        raise argparse.ArgumentTypeError(message) from None


def number_of_seconds(text: str) -> float:
    """Parse a time in seconds."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text} is no number of seconds') from None


def seconds(text: str) -> float:
    """Parse a duration in seconds."""
    value = number_of_seconds(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f'{text} is no positive number of seconds')
    return value


def zone_index(text: str) -> int:
    """Parse the index of a zone of the largest grid."""
    zones = range(max(rows * columns for rows, columns in ZONE_SHAPES))
    with suppress(ValueError):
        if (zone := int(text)) in zones:
            return zone
    raise argparse.ArgumentTypeError(f'{text} is no zone: they are 0 to 15, or 0 to {zones[-1]}')


def bit_period(text: str) -> float:
    """Parse how long a marker holds a bit in seconds."""
    value = number_of_seconds(text)
    least, most = BIT_PERIOD_LIMITS_S
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f'{text} s is not within {least:g} to {most:g} s')
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='retrolidar', description='Read liquid-crystal fiducial markers with a LiDAR.'
    )
    commands = parser.add_subparsers(required=True, metavar='COMMAND')

    demo = commands.add_parser(
        'demo', help='run emulated sensor, driver and detector, and compare with the truth'
    )
    demo.add_argument('scene', nargs='?', default='coffee', help='name or file (default: coffee)')
    demo.add_argument('-o', '--output', type=Path, help='picture (default: demo_SCENE.png)')
    demo.add_argument('--timeout', type=seconds, default=60.0, help='give up after [s]')
    demo.set_defaults(run=_demo)

    emulate = commands.add_parser('emulate', help='be a sensor that sees a scene')
    emulate.add_argument('scene', help='name or file')
    where = emulate.add_mutually_exclusive_group(required=True)
    where.add_argument('--port-link', type=Path, help='in real time, at a serial port linked here')
    where.add_argument('--bag', type=Path, help='at once, into a new rosbag2 directory')
    emulate.add_argument(
        '--storage', choices=STORAGES, default=STORAGES[0], help='of the bag (default: %(default)s)'
    )
    emulate.add_argument('--duration', type=seconds, help='stop after [s]')
    emulate.set_defaults(run=_emulate)

    look = commands.add_parser(
        'watch',
        help='show live what a sensor sees, zone by zone and bit by bit',
        description='On a terminal a picture five times a second, else a line a second. Ctrl-C '
        'ends it. Exit code 1 if a duration ends without any frame.',
    )
    look.add_argument('port', metavar='PORT', help='device of the sensor')
    look.add_argument('--baud', type=int, default=460800, help='bit/s (default: %(default)s)')
    look.add_argument(
        '--protocol',
        choices=PROTOCOLS,
        default='retrolidar',
        help='what the sensor speaks (default: %(default)s)',
    )
    look.add_argument(
        '--zone',
        type=zone_index,
        metavar='N',
        help='whose bits to show (default: the one that blinks most)',
    )
    look.add_argument(
        '--bit-period',
        type=bit_period,
        default=BIT_PERIOD_S,
        metavar='S',
        help='how long a marker holds a bit: two frames [s] (default: %(default)s)',
    )
    look.add_argument('--duration', type=seconds, metavar='S', help='stop after [s]')
    look.set_defaults(run=_watch)

    def add_bag_command(name: str, summary: str) -> argparse.ArgumentParser:
        command = commands.add_parser(name, help=summary)
        command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
        command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
        command.add_argument(
            '--method', choices=METHODS, default=METHODS[0], help='(default: %(default)s)'
        )
        return command

    decode = add_bag_command('decode', 'read the markers in a bag')
    decode.add_argument('--json', action='store_true', help='one JSON object a line')
    decode.set_defaults(run=_decode)

    plot = add_bag_command('plot', 'draw what was read in a bag')
    plot.add_argument('-o', '--output', type=Path, required=True, help='PNG file')
    plot.set_defaults(run=_plot)

    ids = commands.add_parser(
        'ids',
        help='choose marker IDs that are hard to confuse, or check those in use',
        description='The distance of two IDs is the fewest bits, of 31, in which the packet of one '
        'differs from that of the other when the reading of a repeating marker starts at any bit. '
        'At a distance of 8, which the Golay code has when read from the first bit, three wrong '
        'bits do not turn one into the other; at 6 two, at 4 one, at 2 none. An ID has a distance '
        'to itself too, read from any bit but the first.',
    )
    task = ids.add_mutually_exclusive_group(required=True)
    task.add_argument('--count', type=int, metavar='N', help='print so many IDs, one a line')
    task.add_argument(
        '--check',
        type=marker_ids,
        metavar='ID,ID,…',
        help='name the pairs that are too near; exit code 1 if there are any',
    )
    ids.add_argument(
        '--min-distance',
        type=int,
        metavar='BITS',
        help='least distance allowed (default: to choose, the largest possible; to check, 8)',
    )
    ids.set_defaults(run=_ids)

    expected = commands.add_parser(
        'budget',
        help='tell what to expect of a marker: its link, its waking and its battery',
        description='The link is simulated: markers before a wall, each awake for one packet. '
        'Quantities carry their units, as in scene files.',
    )
    for name, default, what in (
        ('size', '3 cm', 'edge of the retroreflector'),
        ('yaw', '0 deg', "angle between the marker's normal and the line of sight"),
        ('distance', '2 m', 'from the sensor'),
        ('cell', '90 mAh', 'capacity of the battery'),
        ('queries', '1', 'packets an hour'),
    ):
        expected.add_argument(f'--{name}', default=default, help=f'{what} (default: %(default)s)')
    expected.add_argument('--json', action='store_true', help='one JSON object')
    expected.set_defaults(run=_budget)

    evaluate = commands.add_parser(
        'evaluate',
        help='run experiments and draw their charts',
        description='Run experiments on emulated frames; without any name, list them. Each writes '
        'NAME.json and NAME.png; --all also writes a page of Markdown that tells of all of them.',
    )
    which = evaluate.add_mutually_exclusive_group()
    which.add_argument('names', nargs='*', default=[], metavar='NAME', help='which to run')
    which.add_argument('--all', action='store_true', help='all of them, and the page')
    evaluate.add_argument('--quick', action='store_true', help='few trials: a look at each')
    evaluate.add_argument('--seed', type=int, default=1, help='(default: %(default)s)')
    evaluate.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='(default: docs/report, with --quick report_quick)',
    )
    evaluate.set_defaults(run=_evaluate)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code: 2 for input that cannot be used."""
    if sys.stdout is None:  # the shell has closed it
        sys.stdout = open(os.devnull, 'w')  # noqa: SIM115 - until the process ends
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Who read our output wants no more of it; the interpreter must not flush into the pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (BagError, ConfigError, OSError, ValueError) as error:
        sys.stdout.flush()
        print(f'retrolidar: {error}', file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        print(f'retrolidar: a library is missing: pip install {error.name}', file=sys.stderr)
        return 2
    return code


if __name__ == '__main__':
    sys.exit(main())
