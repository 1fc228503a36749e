# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics: their names, and qualities that parameters `qos_overrides.TOPIC.…` may change."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

try:
    from rclpy.event_handler import PublisherEventCallbacks
except ImportError:  # before Iron
    from rclpy.qos_event import PublisherEventCallbacks

STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""QoS of a sensor's topics: reliable, so that reliable and best-effort subscribers connect."""
FRAME_QOS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
"""QoS of frames for a detector, which needs all: the queue covers a stall of 20 s."""
EVENTS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)  # come in bursts
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Latched: late-joining subscribers receive the last message."""
_OVERRIDABLE = QoSOverridingOptions.with_default_policies()


@contextmanager
def _override(topic: str) -> Iterator[None]:
    """Raise ValueError for an override that names no quality of service."""
    try:
        yield
    except RuntimeError as error:
        if type(error) is not RuntimeError:  # such as that the node is shut down
            raise
        raise ValueError(f'qos_overrides of {topic}: {error}') from error


def publisher(node: Node, kind: type[Any], topic: str, qos: QoSProfile) -> Publisher:
    """Return a publisher; parameters may set its history, depth and reliability."""
    with _override(topic):
        return node.create_publisher(kind, topic, qos, qos_overriding_options=_OVERRIDABLE)


def latched(node: Node, kind: type[Any], topic: str) -> Publisher:
    """Return a publisher of a latched topic.

    It takes no events: with each message an executor looks through all, of hundreds of these
    topics.
    """
    silent = PublisherEventCallbacks(use_default_callbacks=False)
    return node.create_publisher(kind, topic, LATCHED, event_callbacks=silent)


def subscribe(
    node: Node, kind: type[Any], topic: str, callback: Callable[..., None], qos: QoSProfile
) -> str:
    """Subscribe likewise; return the topic's full name. A callback may take rclpy's info, too."""
    with _override(topic):
        made = node.create_subscription(
            kind, topic, callback, qos, qos_overriding_options=_OVERRIDABLE
        )
    return str(made.topic_name)


def topic_part(frame: str) -> str:
    """Return a TF frame as a part of a topic's name, which takes fewer characters."""
    part = re.sub(r'\W', '_', frame, flags=re.ASCII)
    return f'_{part}' if part[0].isdigit() else part


def topics_of(prefix: str, names: Sequence[str]) -> dict[str, str]:
    """Return a topic by each name; ValueError if two would share one."""
    owners: dict[str, str] = {}
    for name in names:
        topic = prefix + topic_part(name)
        if topic in owners:
            raise ValueError(
                f'{owners[topic]} and {name} would share the topic {topic}: rename one of them'
            )
        owners[topic] = name
    return {name: topic for topic, name in owners.items()}
