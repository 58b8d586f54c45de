# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stand-in for the package `launch`, which the binary wheels of ROS 2 lack.

It provides the parts that launch files use, with the original names and behaviour. Tests import it
only if `launch` is missing.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any


class LaunchDescriptionEntity:
    """Base of all actions."""


class LaunchContext:
    """State of a launch.

    Attributes
    ----------
    launch_configurations : dict of str
        Arguments by name.
    """

    def __init__(self) -> None:
        self.launch_configurations: dict[str, str] = {}
        self.locals = SimpleNamespace()

    def extend_locals(self, extensions: dict[str, Any]) -> None:
        vars(self.locals).update(extensions)


class LaunchDescription(LaunchDescriptionEntity):
    """Actions in the order in which they are executed."""

    def __init__(self, entities: Sequence[Any]) -> None:
        self.entities = list(entities)
