# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS 2 installation that nodes run on, and the domain that they join."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import rclpy

from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.core.topics import SIGNALS
from haptic_accel.devices.rclpy_internals import EventsExecutor
from haptic_accel.graph import machine
from haptic_accel.graph.domain import middleware_defaults
from haptic_accel.graph.machine import Finding
from haptic_accel.graph.stop_signal import DOMAIN
from haptic_accel.materials.folders import config_folder
from haptic_accel.nodes.timing import empty_loop, sharpen_timers

ANNOUNCEMENT = 3.5
"""Duration of the search for other nodes, s: by default, Fast DDS announces nodes every 3 s."""

TIMER_SLACK = Path("/proc/self/timerslack_ns")


LOOP_TIME = 2.0
"""Duration of the empty loop, s."""


def node_findings() -> Iterator[Finding]:
    """Check ROS 2 in the environment of a node, which joins the domain for `ANNOUNCEMENT`."""
    os.environ.update(middleware_defaults(os.environ))
    sharpen_timers()
    names = [each.name or "" for each in metadata.distributions()]
    wheels = [re.fullmatch(r"ros[-_](\w+)[-_]rclpy", name) for name in names]
    distribution = next((w[1] for w in wheels if w), os.environ.get("ROS_DISTRO", ""))
    rclpy.init(args=[])
    try:
        node = rclpy.create_node("haptic_accel_doctor")
        time.sleep(ANNOUNCEMENT)
        published = [t.name for t in SIGNALS if node.count_publishers(t.name)]
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    version = f"{metadata.version('rclpy')} in {Path(rclpy.__file__).parent}"
    yield Finding("ROS 2", "ok", f"{distribution or 'unknown'}, rclpy {version}")
    yield machine.executor(f"{EventsExecutor.__name__} of {EventsExecutor.__module__}")
    yield machine.timer_slack(TIMER_SLACK.read_text().strip() if TIMER_SLACK.is_file() else "")
    middleware = rclpy.get_rmw_implementation_identifier()
    yield machine.middleware(middleware)
    if "fastrtps" in middleware:
        yield machine.profile(distribution, os.environ, config_folder())
    yield machine.discovery_range(os.environ)
    yield machine.domain(os.environ.get(DOMAIN, ""))
    yield machine.other_graph(published)
    yield machine.rate_held(empty_loop(DEFAULT_RATE, LOOP_TIME))
