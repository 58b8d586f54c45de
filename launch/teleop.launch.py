# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The teleoperation graph: ``ros2 launch haptic_accel teleop.launch.py controller:=dynamic``."""

from __future__ import annotations

from launch import LaunchDescription

from haptic_accel.graph.launching import launched
from haptic_accel.setup.arguments import GraphArguments, parse_arguments
from haptic_accel.setup.processes import graph
from haptic_accel.setup.words import described


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes; the end of one ends all."""
    return launched(described(GraphArguments), lambda words: graph(parse_arguments(words)))
