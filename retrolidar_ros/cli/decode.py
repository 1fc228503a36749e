# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Print the detections or tracks in a bag."""

import argparse
import json
import math
import sys

import numpy as np

from retrolidar_ros.bag import read_frames
from retrolidar_ros.cli.arguments import add_bag, add_detector_options, detector_values
from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.detection import Track
from retrolidar_ros.detector.explain import Explanation
from retrolidar_ros.detector.findings import Finding

NOTHING_READ = 3  # exit code
HELP = 'read the markers in a bag'
DESCRIPTION = (
    'If markers could be read better, standard error says why. '
    f'Exit code {NOTHING_READ} if nothing is read.'
)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_bag(command)
    add_detector_options(command)
    command.add_argument('--json', action='store_true', help='print one JSON object per line')
    command.add_argument(
        '--tracks',
        action='store_true',
        help='print where each marker is at every frame, once it is read',
    )
    command.add_argument('--explain', action='store_true', help='describe every blinking zone')


def run(arguments: argparse.Namespace) -> int:
    """Print detections or tracks as JSON lines or a table, and why markers are not read."""
    decoding = Decoding(detector_values(arguments))
    frames = read_frames(arguments.bag, arguments.topic)
    if arguments.tracks:
        header, tracks = TRACK_HEADER, decoding.follow(frames)
        lines = map(track_to_json if arguments.json else track_to_text, tracks)
    else:
        header, detections = TEXT_HEADER, decoding.detect(frames)
        lines = map(to_json if arguments.json else to_text, detections)
    for number, line in enumerate(lines):
        if not arguments.json and not number:
            print(header)
        print(line)
    sys.stdout.flush()
    print_hints(decoding, decoding.explanation(), describe=arguments.explain)
    return 0 if decoding.detections else NOTHING_READ


def print_hints(
    decoding: Decoding, explanation: Explanation, *, describe: bool = False
) -> list[Finding]:
    """Print to standard error, and return, why markers are not read; zones on demand."""
    findings = explanation.findings()
    lines = [str(one) for one in findings]
    if describe:
        lines += decoding.table(explanation, findings)
    for line in lines:
        print(line, file=sys.stderr)
    return findings


def to_json(detection: Detection) -> str:
    """Return a detection as a line of JSON in SI units, dB and nats; null: not measured."""
    x, y, z = detection.place.position_m.tolist()
    return json.dumps(
        {
            'stamp': detection.stamp_ns * 1e-9,
            'id': detection.id,
            'x': x,
            'y': y,
            'z': z,
            'range': detection.place.range_m,
            'range_stddev': detection.place.range_stddev_m,
            'snr': detection.snr_db,
            'evidence': _or_none(detection.evidence),
            'decision_margin': _or_none(detection.decision_margin),
            'score': detection.score,
            'bit_period': detection.bit_period_s,
            'corrected_bits': detection.corrected_bits,
            'packets': detection.packets,
            'zones': list(detection.zones),
            'start': detection.start_ns * 1e-9,
            'end': detection.end_ns * 1e-9,
        }
    )


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


TEXT_HEADER = (
    '        stamp [s]    id  range [m]  SNR [dB]  evidence  margin  score  corrected  packets'
    '  zones'
)


def to_text(detection: Detection) -> str:
    """Return a detection as one line under `TEXT_HEADER`."""
    zones = ','.join(map(str, detection.zones))
    return (
        f'{detection.stamp_ns * 1e-9:17.3f}  {detection.id:4d}  {detection.place.range_m:9.3f}  '
        f'{detection.snr_db:8.1f}  {detection.evidence:8.1f}  {detection.decision_margin:6.1f}  '
        f'{detection.score:5.2f}  {detection.corrected_bits:9d}  {detection.packets:7d}  {zones}'
    )


def track_to_json(track: Track) -> str:
    """Return a track as one line of JSON: metres, metres a second, nats, seconds of ROS time."""
    names = 'x', 'y', 'z', 'x_stddev', 'y_stddev', 'z_stddev', 'vx', 'vy', 'vz'
    deviations_m = np.sqrt(np.diag(track.place.covariance)[:3])
    values = np.concatenate([track.place.position_m, deviations_m, track.velocity]).tolist()
    return json.dumps(
        {
            'stamp': track.stamp_ns * 1e-9,
            'id': track.id,
            **dict(zip(names, values, strict=True)),
            'range': track.place.range_m,
            'range_stddev': track.place.range_stddev_m,
            'presence': track.presence,
        }
    )


TRACK_HEADER = (
    '        stamp [s]    id    x [m]    y [m]    z [m]  range [m]  stddev [m]  speed [m/s]'
    '  presence'
)


def track_to_text(track: Track) -> str:
    """Return a track as one line under `TRACK_HEADER`; its speed is that along the range."""
    place = track.place
    x, y, z = place.position_m.tolist()
    # Rounded, and no minus before zero.
    speed = round(float(track.velocity @ place.position_m) / place.range_m, 3) + 0.0
    return (
        f'{track.stamp_ns * 1e-9:17.3f}  {track.id:4d}  {x:7.3f}  {y:7.3f}  {z:7.3f}  '
        f'{place.range_m:9.4f}  {place.range_stddev_m:10.4f}  {speed:11.3f}  {track.presence:8.1f}'
    )
