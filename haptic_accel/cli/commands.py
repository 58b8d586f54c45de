# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The command ``haptic-accel``: its verbs, their headings and summaries."""

from __future__ import annotations

import click

from haptic_accel import __version__
from haptic_accel.cli.lazy import LazyGroup

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
EMULATE = LazyGroup(
    "emulate",
    {
        "Hardware": {
            "can": "two arms of ODrives on CAN",
            "serial": "boards of handle and tool on USB serial",
        },
        "Network": {
            "network": "delay, jitter and loss between two hosts",
        },
    },
    help="Emulate boards or arms to test the drivers without hardware, or a bad network.",
    examples=["haptic-accel emulate serial", "haptic-accel emulate can faults:=estimates@2"],
)
BENCH = LazyGroup(
    "bench",
    {
        "Kinds": {
            "latency": "latency, losses and CPU of the graph, beside two references",
            "fidelity": "tracking error of each controller on every rig, grip and input",
            "network": "energy, stability and error of two coupled hosts over networks",
        }
    },
    help="Measure latency, CPU, losses and tracking error.",
    examples=["haptic-accel bench latency rig:=ideal --rate 2000", "haptic-accel bench fidelity"],
)
TEXTURE = LazyGroup(
    "texture",
    {
        "Verbs": {
            "build": "build a model from recordings with speed, force and acceleration",
            "import": "make a model of another program's file",
            "show": "show a model's range and spectra",
            "render": "write a model's acceleration as a sound file",
        }
    },
    help="Build, import, show and render models of textures.",
    examples=[
        "haptic-accel texture build drag.csv --rate 10000 --out wood.yaml",
        "haptic-accel texture render plywood --speed 80 --force 1 --out wood.wav",
    ],
)
STUDY = LazyGroup(
    "study",
    {
        "Before": {
            "new": "write a study from a template",
            "check": "check a study, and describe what it asks",
            "simulate": "run a study with simulated observers, and estimate its power",
        },
        "Participants": {
            "run": "run the session of a new participant",
            "resume": "go on with a session that was stopped or interrupted",
            "status": "show participants, progress and safety, without conditions",
            "verify": "compare logs with the journal and the notebook",
            "delete-participant": "delete a participant's log, bags and results",
        },
        "After": {
            "unblind": "let conditions be analysed, and log that and why",
            "analyze": "write the report with tables and figures",
            "export": "write the data as CSV, Psych-DS or BIDS",
        },
    },
    help="Plan, run and analyse studies with participants.",
    examples=[
        "haptic-accel study new --template compensated_or_not my_study",
        "haptic-accel study run my_study --participant P07",
    ],
)

SECTIONS = {
    "First touch": {
        "touch": "touch a surface on a page, without ROS or hardware",
    },
    "Graph": {
        "teleop": "run the teleoperation graph",
        "control": "change controller, surface or grip of a running graph",
        "estop": "stop a running graph in an emergency, or release it",
        "scope": "serve a page that shows a running graph",
    },
    "Devices": {
        "bringup": "bring up a rig in five steps, and write its parameter file",
        "calibrate": "measure gain and offset of an accelerometer by gravity",
        "emulate": "emulate boards or arms without hardware, or a bad network",
    },
    "Recording and analysis": {
        "record": "start, pause, split or stop the recording of a running graph",
        "bag": "inspect and repair bags",
        "replay": "play a bag again, with any controller",
        "analyze": "write the paper's tables and plots from bags",
        "experiment": "run the paper's experiment and report Table II",
    },
    "Studies with participants": {
        "study": "plan, run and analyse studies with participants",
    },
    "Design": {
        "identify": "fit the handle's model with the paper's sweep",
        "design": "predict error, force and margins of a controller",
    },
    "Surfaces": {
        "texture": "build, import, show and render models of textures",
    },
    "Machine": {
        "keys": "make keys for two hosts",
        "bench": "measure latency, CPU, losses and tracking error",
        "doctor": "find causes of timing jitter on this machine and suggest fixes",
    },
}
"""Summaries of the verbs by heading."""

command_line = LazyGroup(
    "haptic-accel",
    SECTIONS,
    groups=[BAG, EMULATE, BENCH, TEXTURE, STUDY],
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
