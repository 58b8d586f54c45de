"""``haptic-accel teleop``: the graph as supervised processes, where there is no ros2 launch."""

from __future__ import annotations

from collections.abc import Sequence

import click

from haptic_accel.cli.options import Verb, words
from haptic_accel.cli.running import StopOnSignal, conclude, show
from haptic_accel.graph.arguments import GraphArguments, parse_arguments
from haptic_accel.graph.processes import graph
from haptic_accel.graph.supervisor import Supervisor


@click.command(
    cls=Verb,
    examples=[
        "haptic-accel teleop controller:=inverse surface:=vinyl duration:=10",
        "haptic-accel teleop master:=serial slave:=serial config:=mine.yaml",
        "haptic-accel teleop scope:=true",
    ],
)
@words(GraphArguments)
def teleop(words: Sequence[str]) -> int:
    """Run the five nodes of the teleoperation graph until Ctrl-C."""
    arguments = parse_arguments(words)
    processes = graph(arguments)
    with StopOnSignal() as stop:
        outcome = Supervisor(processes, on_line=show).run(stop)
    return conclude(outcome, endless=arguments.duration == 0)
