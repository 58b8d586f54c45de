# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Excites and records a handle: ``ros2 launch haptic_accel identify.launch.py bag:=pinch``.

Afterwards ``haptic-accel identify --from pinch`` fits the models.
"""

from __future__ import annotations

from launch import LaunchDescription

from haptic_accel.graph.launching import launched
from haptic_accel.setup.arguments import IdentifyArguments
from haptic_accel.setup.processes import identification_graph
from haptic_accel.setup.words import described, parse_assignments


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes; the end of one ends all."""
    return launched(
        described(IdentifyArguments),
        lambda words: identification_graph(parse_assignments(words, IdentifyArguments)),
    )
