"""``haptic-accel record``: start, pause, split and stop the recording of a graph that runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import click

from haptic_accel.cli.options import Verb, one_of, words
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.process import DONE
from haptic_accel.graph.words import parse_words

PATIENCE = 120.0
"""How long an answer may take, s: a file that is finished may have to be compressed first."""

ACTIONS = {
    "start": "go on after a pause, or begin another bag after a stop",
    "pause": "leave out what comes, until start",
    "split": "put what comes into another file of the bag",
    "stop": "finish the bag; the graph goes on",
    "status": "say what is recorded",
}
"""What can be done, each a service of the recorder."""


@dataclass(frozen=True)
class RecordArguments(Checked):
    """Which recording."""

    namespace: str = parameter("", "of the graph")


@click.command(cls=Verb, examples=["haptic-accel record pause", "haptic-accel record status"])
@click.argument("action", type=one_of(ACTIONS), metavar="|".join(ACTIONS))
@words(RecordArguments)
def record(action: str, words: Sequence[str]) -> int:
    """Control the recording of a running graph."""
    arguments = parse_words(words, RecordArguments)
    # ROS takes a while to import: wrong words are refused without it.
    from haptic_accel.cli.calling import connected
    from haptic_accel.nodes.graph_requests import trigger

    with connected(arguments.namespace) as graph:
        print(graph.send(trigger(f"recorder/{action}"), PATIENCE))
    return DONE
