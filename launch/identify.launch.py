"""Excites and records a handle: ``ros2 launch haptic_accel identify.launch.py bag:=pinch``.

Afterwards ``haptic-accel identify --from pinch`` fits the models.
"""

from __future__ import annotations

from launch import LaunchDescription

from haptic_accel.startup.arguments import IdentifyArguments, parse_arguments
from haptic_accel.startup.graph import identification_graph
from haptic_accel.startup.launching import launched


def generate_launch_description() -> LaunchDescription:
    """Declare the arguments and start the nodes, each of whose ends ends all."""
    return launched(
        IdentifyArguments,
        lambda words: identification_graph(parse_arguments(words, IdentifyArguments)),
    )
