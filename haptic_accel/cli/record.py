# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""``haptic-accel record``: start, pause, split and stop the recording of a running graph."""

from __future__ import annotations

import asyncio
import re

import click

from haptic_accel.cli.options import arguments, one_of, verb
from haptic_accel.cli.output import next_command
from haptic_accel.setup.words import NamespaceArguments

ANSWER_TIMEOUT = 30.0
"""Time-out for an answer, s; the recorder flushes a finished file to disk first."""

WHOLE = re.compile(r"(.+): \d+ messages, \d+ dropped")
"""Pattern of the recorder's answer for a complete bag; the ROS service has no field for that."""

ACTIONS = {
    "start": "continue after a pause, or begin another bag after a stop",
    "pause": "leave out messages until start",
    "split": "continue in another file of the bag",
    "stop": "finish the bag; the graph goes on",
    "status": "show the state of the recording",
}
"""Actions on a recording, each a service of the recorder."""


@verb(
    "haptic-accel record status",
    "haptic-accel record pause",
    "haptic-accel record stop namespace:=left",
)
@click.argument("action", type=one_of(ACTIONS), metavar="|".join(ACTIONS))
@arguments(NamespaceArguments)
def record(action: str, arguments: NamespaceArguments) -> None:
    """Control the recording of a running graph."""
    # ROS is slow to import; wrong arguments are refused without it.
    from haptic_accel.cli.joining import connected
    from haptic_accel.nodes.graph_requests import trigger

    with connected(arguments.namespace, answering=ANSWER_TIMEOUT) as client:
        answer = asyncio.run(client.send(trigger(f"recorder/{action}")))
    print(answer)
    if action == "stop" and (whole := WHOLE.fullmatch(answer)):
        print(next_command("analyze", whole[1]))
