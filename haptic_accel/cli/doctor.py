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

"""``haptic-accel doctor``: causes of timing jitter on this machine, with suggested fixes.

Nothing is changed. ``haptic-accel bench latency`` measures the graph itself.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import click
from rich.markup import escape
from rich.text import Text

from haptic_accel.cli.doctor_audio import AudioTrialArguments, examine
from haptic_accel.cli.ending import StoppedError
from haptic_accel.cli.options import arguments, json_option, one_of, verb
from haptic_accel.cli.output import save
from haptic_accel.cli.tables import print_table
from haptic_accel.core.sampling import DEFAULT_RATE
from haptic_accel.core.tables import ResultTable
from haptic_accel.core.tick import COMPILED, TICK
from haptic_accel.devices.audio import AUDIO
from haptic_accel.graph import machine
from haptic_accel.graph.machine import Finding
from haptic_accel.graph.ros_packages import INSTALL_ROS, has_ros
from haptic_accel.graph.stop_signal import DOMAIN
from haptic_accel.materials.folders import config_folder

COLOURS = {"ok": "green", "warning": "yellow", "problem": "red"}

LOOP_TIME = 2.0
"""Length of the empty loop, s."""


@verb(
    "haptic-accel doctor",
    "haptic-accel doctor audio",
    "haptic-accel doctor audio preset:=dualsense",
)
@click.argument("part", required=False, type=one_of([AUDIO]), metavar=f"[{AUDIO}]")
@arguments(AudioTrialArguments)
@json_option
def doctor(part: str | None, arguments: AudioTrialArguments, json_file: Path | None) -> None:
    """Find causes of timing jitter on this machine and suggest fixes.

    Nothing is changed. An empty loop of two seconds shows whether this machine, now, can hold the
    default rate; haptic-accel bench latency measures the graph itself.

    With audio, list the sound cards, and what is in between. Play a soft tone on each channel of
    a card that device:=NAME or preset:=NAME names, ask which one is felt, and write file:=FILE.
    """
    if part:
        examine(arguments, json_file)
        return
    findings = [*machine.machine_findings(), tick_finding()]
    unusable = ""
    try:
        findings += ros_findings()
    except Exception as error:  # a broken installation may raise anything
        unusable = " ".join(f"{type(error).__name__}: {error}".split())
    _print(findings)
    save({"findings": [asdict(finding) for finding in findings]}, json_file)
    if unusable:
        raise StoppedError(f"rclpy cannot be used: {unusable}")


def tick_finding() -> Finding:
    """Return what runs in every sample."""
    if TICK == COMPILED:
        return Finding("tick", "ok", TICK)
    fix = "install a C compiler and Python's headers (gcc, python3-dev), then haptic_accel again"
    return Finding("tick", "warning", TICK, "a sample takes more processor time", fix)


def ros_findings() -> Iterator[Finding]:
    """Check ROS 2 in the environment of a node."""
    if not has_ros():
        meaning = "no graph runs here; lockstep, analysis, design and textures do"
        yield Finding("ROS 2", "warning", "not installed", meaning, INSTALL_ROS)
        return
    # Imports ROS, which may be broken.
    from haptic_accel.nodes.empty_loop import empty_loop
    from haptic_accel.nodes.installation import describe_installation

    ros = describe_installation()
    environment = os.environ
    yield Finding("ROS 2", "ok", f"{ros.distribution or 'unknown'}, rclpy {ros.rclpy}")
    yield machine.executor(ros.executor)
    yield machine.timer_slack(ros.timer_slack)
    yield machine.middleware(ros.middleware)
    if "fastrtps" in ros.middleware:
        yield machine.profile(ros.distribution, environment, config_folder())
    yield machine.discovery_range(environment)
    yield machine.domain(environment.get(DOMAIN, ""))
    yield machine.other_graph(ros.published)
    yield machine.rate_held(empty_loop(DEFAULT_RATE, LOOP_TIME))


def _print(findings: Sequence[Finding]) -> None:
    rows = []
    for finding in findings:
        colour = COLOURS[finding.level]
        text = escape(finding.found)
        for label, line in (("meaning", finding.meaning), ("fix", finding.fix)):
            text += f"\n[bold]{label}:[/bold] {escape(line)}" if line else ""
        level = Text(finding.level, style=colour)
        rows.append((level, finding.name, Text.from_markup(text)))
    headings = ("", "check", "finding, meaning and fix")
    print_table(ResultTable(headings, rows, "Real time on this machine", left=3))
