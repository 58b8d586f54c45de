# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""ROS 2 installation that nodes run on, and the domain that they join."""

from __future__ import annotations

import os
import re
import time
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import rclpy

from haptic_accel.core.topics import SIGNALS
from haptic_accel.devices.rclpy_internals import EventsExecutor
from haptic_accel.graph.middleware import middleware_defaults
from haptic_accel.nodes.timing import sharpen_timers

ANNOUNCEMENT = 3.5
"""Time to look for other nodes, s: without a profile, Fast DDS announces nodes every 3 s."""

TIMER_SLACK = Path("/proc/self/timerslack_ns")


@dataclass(frozen=True)
class Installation:
    """Properties of the installation for a node of the graph.

    Attributes
    ----------
    distribution : str
        Name of the ROS 2 distribution; empty if unknown.
    rclpy : str
        Version and folder of the client library.
    executor, middleware : str
        Executor that nodes run on, and implementation of the middleware.
    timer_slack : str
        Time by which the kernel may delay a node's timers, ns; empty if unknown.
    published : tuple of str
        Signals of the graph that a node in this domain publishes already.
    """

    distribution: str
    rclpy: str
    executor: str
    middleware: str
    timer_slack: str
    published: tuple[str, ...]


def describe_installation() -> Installation:
    """Describe the installation; join the domain for `ANNOUNCEMENT`, as a node would."""
    os.environ.update(middleware_defaults(os.environ))
    sharpen_timers()
    names = [each.name or "" for each in metadata.distributions()]
    wheels = [re.fullmatch(r"ros[-_](\w+)[-_]rclpy", name) for name in names]
    rclpy.init(args=[])
    try:
        node = rclpy.create_node("haptic_accel_doctor")
        time.sleep(ANNOUNCEMENT)
        published = tuple(t.name for t in SIGNALS if node.count_publishers(t.name))
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return Installation(
        next((w[1] for w in wheels if w), os.environ.get("ROS_DISTRO", "")),
        f"{metadata.version('rclpy')} in {Path(rclpy.__file__).parent}",
        f"{EventsExecutor.__name__} of {EventsExecutor.__module__}",
        rclpy.get_rmw_implementation_identifier(),
        TIMER_SLACK.read_text().strip() if TIMER_SLACK.is_file() else "",
        published,
    )
