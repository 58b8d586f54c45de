# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Command ``haptic-accel``: its subcommands, with headings and summaries."""

from __future__ import annotations

import click

from haptic_accel import __version__
from haptic_accel.cli.lazy import COMMANDS_GROUP, LazyGroup

BAG = LazyGroup(
    "bag",
    {
        "Verbs": {
            "info": "show topics, recording settings and damage of a bag",
            "repair": "repair bags whose recording was cut off",
        }
    },
    help="Inspect bags, and repair those whose recording was cut off.",
    examples=["haptic-accel bag info bags/text", "haptic-accel bag repair bags/*"],
)
BENCH = LazyGroup(
    "bench",
    {"Kinds": {"latency": "latency, losses and CPU of the graph, beside two references"}},
    help="Measure latency, CPU and losses of the graph on this machine.",
    moved={
        "fidelity": "python benchmarks/fidelity.py in the source",
        "network": "python benchmarks/coupling_over_networks.py in the source",
    },
    examples=["haptic-accel bench latency rig:=ideal --rate 2000"],
)

SECTIONS = {
    "First touch": {"touch": "touch a surface on a page, without ROS or hardware"},
    "Graph": {
        "teleop": "run the teleoperation graph",
        "control": "change controller, surface or grip of a running graph",
        "estop": "stop a running graph in an emergency, or release it",
        "scope": "serve a page that shows a running graph",
    },
    "Devices": {"calibrate": "measure gain and offset of an accelerometer by gravity"},
    "Recording and analysis": {
        "record": "start, pause, split or stop the recording of a running graph",
        "bag": "inspect and repair bags",
        "replay": "play a bag again, with any controller",
        "analyze": "write the paper's tables and plots from bags",
        "experiment": "run the paper's experiment and report Table II",
    },
    "Studies with participants": {},
    "Design": {
        "identify": "fit the handle's model with the paper's sweep",
        "design": "predict error, force and margins of a controller",
    },
    "Surfaces": {},
    "Machine": {
        "bench": "measure latency, CPU and losses of the graph",
        "doctor": "find causes of timing jitter on this machine; audio: try a sound card",
    },
}
"""Summaries of subcommands by heading; kits add subcommands to the empty headings."""

command_line = LazyGroup(
    "haptic-accel",
    SECTIONS,
    groups=[BAG, BENCH],
    entry_points=COMMANDS_GROUP,
    help="Haptic teleoperation with acceleration feedback: feel what a remote tool touches.",
    context_settings={
        "help_option_names": ["-h", "--help"],
        "max_content_width": 100,
        "show_default": True,
    },
    examples=[
        "haptic-accel teleop controller:=dynamic surface:=text",
        "haptic-accel experiment --lockstep",
        "haptic-accel VERB --help",
    ],
)
click.version_option(__version__, message="%(prog)s %(version)s")(command_line)
