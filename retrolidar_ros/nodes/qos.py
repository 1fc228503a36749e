# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Qualities of service, each of which a parameter `qos_overrides.TOPIC.…` may change."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

OVERRIDABLE = QoSOverridingOptions.with_default_policies()
"""Lets parameters set history, depth and reliability of a topic."""

STREAM = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
"""What a sensor sends: reliable, so that subscribers of either kind connect."""
STREAM_HEARD = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
EVENTS = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
"""What comes now and then, and in bursts."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A state, which who comes late hears, too."""
