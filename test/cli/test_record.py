# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages of `haptic-accel record` where there is nothing to record; more in test/nodes."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from running import Command
from verbs import refusal


def test_without_a_graph_it_says_so(haptic_accel: Callable[..., Command]) -> None:
    command = haptic_accel("record", "status", "namespace:=/nowhere")
    assert command.end() == 1, command.text
    (line,) = command.lines
    assert line == "haptic-accel: /nowhere/recorder: does not answer; is the graph running?"


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["split", "name:=x"], "name: no such argument"),
        (["rewind"], "'rewind': must be one of start, pause, split, stop, status"),
        (["strat"], "(did you mean start?)"),
    ],
)
def test_what_it_cannot_do_is_refused_by_name(words: list[str], named: str) -> None:
    assert named in refusal("record", *words)
