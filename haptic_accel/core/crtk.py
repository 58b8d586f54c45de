# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Commands of CRTK to one arm: operating states with their transitions, and position control."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import Checked, parameter

CRTK_MESSAGES = "crtk_msgs"
"""ROS package of CRTK's messages; without it no state is published or changed."""

DISABLED, ENABLED, PAUSED, FAULT = STATES = ("DISABLED", "ENABLED", "PAUSED", "FAULT")

COMMANDS = ("enable", "disable", "pause", "resume", "home", "unhome")
ENABLE, DISABLE, PAUSE, RESUME, HOME, UNHOME = COMMANDS

_ALLOWED = {ENABLE: (DISABLED, ENABLED, FAULT), PAUSE: (ENABLED, PAUSED), RESUME: (PAUSED,)}
"""States in which a command is valid, if not all are (CRTK, "State Transitions")."""

_LEVELS = ("unconfigured", "inactive", "active")
"""States of a managed node: closed; open, without force; with forces."""

_UP, _DOWN = ("configure", "activate"), ("cleanup", "deactivate")
"""Transitions from each level to the next one, and back."""

_RANGES = {
    ENABLE: (2, 2),
    DISABLE: (0, 1),
    PAUSE: (1, 1),
    RESUME: (2, 2),
    HOME: (1, 2),
    UNHOME: (0, 0),
}
"""Lowest and highest level after each command."""


def refusal(command: str, state: str) -> str:
    """Return the reason to reject a command in a state of CRTK; empty if it is accepted."""
    if command not in COMMANDS:
        return f"no such command; there are {', '.join(COMMANDS)}"
    return "" if state in _ALLOWED.get(command, STATES) else f"not while {state}"


def transitions(command: str, managed: str) -> tuple[str, ...]:
    """Return the transitions of a managed node for a command, in order.

    Parameters
    ----------
    command : str
        One of `COMMANDS`.
    managed : str
        State of the node; after a shutdown there are no transitions.

    Examples
    --------
    >>> transitions("enable", "unconfigured"), transitions("unhome", "active")
    (('configure', 'activate'), ('deactivate', 'cleanup'))
    """
    if managed not in _LEVELS:
        return ()
    here = _LEVELS.index(managed)
    low, high = _RANGES[command]
    there = min(max(here, low), high)
    return _UP[here:there] if there > here else _DOWN[there:here][::-1]


@dataclass(frozen=True)
class PositionServoParameters(Checked):
    """Gains of an arm's position control; the safety layer limits its force."""

    stiffness: float = parameter(
        250.0, "stiffness towards a commanded position: that of the coupling", "N/m", 0, 5000.0
    )
    # The simulated slave has 60 g, and 3 N s/m in its joints.
    damping: float = parameter(
        4.0, "damping of commanded positions (0.9 of critical in simulation)", "N s/m", 0, 50.0
    )


class PositionServo:
    """Spring and damper to a set-point; inactive without a set-point.

    Parameters
    ----------
    parameters : PositionServoParameters

    Attributes
    ----------
    set_point : tuple of float or None
        Commanded position, m; None while no position is commanded.

    Examples
    --------
    >>> servo = PositionServo(PositionServoParameters(stiffness=100.0, damping=2.0))
    >>> servo.set_point = (0.01, 0.0, 0.0)
    >>> servo.force((0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
    (0.8, 0.0, 0.0)
    """

    def __init__(self, parameters: PositionServoParameters) -> None:
        self._parameters = parameters
        self.set_point: Vector | None = None

    def force(self, position: Vector, velocity: Vector) -> Vector | None:
        """Return the force, N, for a position, m, and velocity, m/s; None without a set-point."""
        if self.set_point is None:
            return None
        p = self._parameters
        x, y, z = (
            p.stiffness * (goal - coordinate) - p.damping * speed
            for goal, coordinate, speed in zip(self.set_point, position, velocity, strict=True)
        )
        return x, y, z
