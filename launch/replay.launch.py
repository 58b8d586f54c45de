# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Plays a bag again: ``ros2 launch haptic_accel replay.launch.py bag:=BAG controller:=inverse``.

`rate` is the speed, as with ``ros2 bag play``. Arguments of the graph that are left empty default
to those stored in the bag.
"""

from __future__ import annotations

from launch import LaunchDescription

from haptic_accel.graph.launching import launched
from haptic_accel.setup.processes import graph
from haptic_accel.setup.replay import described_replay, replay_arguments


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes; the end of one ends all."""
    return launched(
        described_replay(),
        lambda words: graph(
            replay_arguments(word for word in words if not word.endswith(":=")).graph
        ),
    )
