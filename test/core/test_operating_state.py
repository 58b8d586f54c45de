# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import pytest

from haptic_accel.core.operating_state import COMMANDS, STATES, refusal, transitions

INVALID = {
    *(("DISABLED", "pause"), ("DISABLED", "resume")),
    *(("ENABLED", "resume"), ("PAUSED", "enable")),
    *(("FAULT", "pause"), ("FAULT", "resume")),
}
"""Cells of CRTK's table of state transitions that say "(invalid)"."""


def test_commands_are_refused_where_the_standard_says_so() -> None:
    found = {
        (state, command) for state in STATES for command in COMMANDS if refusal(command, state)
    }
    assert found == INVALID
    assert refusal("pause", "FAULT") == "not while FAULT"


def test_an_unknown_command_is_refused_with_those_that_there_are() -> None:
    assert refusal("enalbe", "DISABLED") == (
        "no such command; there are enable, disable, pause, resume, home, unhome"
    )


@pytest.mark.parametrize(
    ("command", "managed", "expected"),
    [
        ("enable", "unconfigured", ("configure", "activate")),
        ("enable", "inactive", ("activate",)),
        ("enable", "active", ()),
        ("disable", "active", ("deactivate",)),
        ("disable", "unconfigured", ()),
        ("pause", "active", ("deactivate",)),
        ("resume", "inactive", ("activate",)),
        ("home", "unconfigured", ("configure",)),
        ("home", "active", ()),
        ("unhome", "active", ("deactivate", "cleanup")),
        ("enable", "finalized", ()),
    ],
)
def test_a_command_leads_through_the_states_of_a_managed_node(
    command: str, managed: str, expected: tuple[str, ...]
) -> None:
    assert transitions(command, managed) == expected
