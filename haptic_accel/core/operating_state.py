# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Operating states of CRTK, and the node transitions that its commands require."""

from __future__ import annotations

MESSAGES = "crtk_msgs"
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
