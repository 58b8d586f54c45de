# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel teleop``: the graph as supervised processes, without ros2 launch."""

from __future__ import annotations

from haptic_accel.cli.options import arguments, verb
from haptic_accel.cli.running import run_shown
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.processes import graph


@verb(
    "haptic-accel teleop controller:=inverse surface:=vinyl duration:=10",
    "haptic-accel teleop master:=serial slave:=serial params_file:=mine.yaml",
    "haptic-accel teleop scope:=true side:=master peer:=ROBOT keys:=keys",
)
@arguments(GraphArguments)
def teleop(arguments: GraphArguments) -> None:
    """Run the graph until Ctrl-C: both arms, or one of them with a peer host."""
    run_shown(graph(arguments), endless=arguments.duration == 0)
