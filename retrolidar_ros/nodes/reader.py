# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `reader`: driver and detector of one sensor, or of many, in one process."""

from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from retrolidar_ros.nodes.detector import DetectorNode
from retrolidar_ros.nodes.diagnostics import DiagnosticsPublisher
from retrolidar_ros.nodes.driver import DriverNode
from retrolidar_ros.nodes.parameters import NAME, Parameters, optical_frame, sensor_names
from retrolidar_ros.nodes.qos import topics_of
from retrolidar_ros.nodes.transforms import TransformSender


def create_nodes() -> list[Node]:
    """Return the nodes of the process, drivers first; ValueError for impossible parameters."""
    reader = Node('reader')
    values = Parameters(reader, 'reader').values
    ports = values['ports']
    names = sensor_names(values['names'], ports)
    if len(names) != len(ports):
        raise ValueError(f'names: {len(names)} of them for {len(ports)} ports')
    spaces = topics_of(f'{reader.get_namespace().rstrip("/")}/', names)
    if len(set(ports)) < len(ports):
        raise ValueError(f'ports: {", ".join(ports)} are not all different')
    board, sender = DiagnosticsPublisher(reader), TransformSender(reader)
    if not ports:
        detector = DetectorNode(board, sender)
        return [DriverNode(detector.process_frame, board), detector, reader]
    drivers: list[Node] = []
    detectors: list[Node] = []
    for name, port in zip(names, ports, strict=True):
        named = _options(spaces[name], child_frame=f'{name}_{NAME}')
        detector = DetectorNode(board, sender, **named)
        options = _options(spaces[name], serial_port=port, frame_id=optical_frame(name))
        drivers.append(DriverNode(detector.process_frame, board, **options))
        detectors.append(detector)
    return [*drivers, *detectors, reader]


def _options(namespace: str, **parameters: str) -> dict[str, Any]:
    """Return a node's options whose namespace and parameters override those of the process.

    The `namespace` of a node would not: `__ns` on the command line overrides it.
    """
    return {
        'cli_args': ['--ros-args', '-r', f'__ns:={namespace}'],
        'parameter_overrides': [Parameter(key, value=one) for key, one in parameters.items()],
    }
