# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""CRTK's operating states and position control of one arm."""

from __future__ import annotations

import pytest

from haptic_accel.core.crtk import (
    COMMANDS,
    STATES,
    PositionServo,
    PositionServoParameters,
    refusal,
    transitions,
)
from haptic_accel.core.model import ZERO

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


GOAL = (0.02, -0.01, 0.0)


def test_there_is_no_force_without_a_set_point() -> None:
    servo = PositionServo(PositionServoParameters())
    assert servo.force(GOAL, GOAL) is None
    servo.set_point = GOAL
    assert servo.force(GOAL, ZERO) == ZERO


@pytest.mark.parametrize(("damping", "overshoots"), [(1.0, True), (20.0, False)])
def test_a_mass_comes_to_rest_at_the_set_point(damping: float, overshoots: bool) -> None:
    mass, period = 0.1, 1e-4
    servo = PositionServo(PositionServoParameters(stiffness=200.0, damping=damping))
    servo.set_point = GOAL
    position, velocity, farthest = list(ZERO), list(ZERO), 0.0
    for _ in range(30_000):
        force = servo.force(tuple(position), tuple(velocity))  # type: ignore[arg-type]
        assert force is not None
        velocity = [v + f / mass * period for v, f in zip(velocity, force, strict=True)]
        position = [p + v * period for p, v in zip(position, velocity, strict=True)]
        farthest = max(farthest, position[0])
    assert position == pytest.approx(GOAL, abs=1e-6)
    # Critical damping is 2 sqrt(200 N/m 0.1 kg) = 8.9 N s/m.
    assert (farthest > 1.01 * GOAL[0]) is overshoots
