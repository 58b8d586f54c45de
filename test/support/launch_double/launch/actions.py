# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Actions of a launch description."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from launch import LaunchContext, LaunchDescriptionEntity
from launch.substitutions import TextSubstitution


class DeclareLaunchArgument(LaunchDescriptionEntity):
    """An argument with its default."""

    def __init__(self, name: str, *, default_value: str, description: str) -> None:
        self.name = name
        self.default_value = [TextSubstitution(text=default_value)]
        self.description = description

    def execute(self, context: LaunchContext) -> None:
        context.launch_configurations.setdefault(self.name, self.default_value[0].text)


class OpaqueFunction(LaunchDescriptionEntity):
    """A function that returns further actions."""

    def __init__(self, *, function: Callable[[LaunchContext], list[Any]]) -> None:
        self._function = function

    def execute(self, context: LaunchContext) -> list[Any]:
        return self._function(context)


class RegisterEventHandler(LaunchDescriptionEntity):
    """Registration of an event's handler."""

    def __init__(self, event_handler: Any) -> None:
        self.event_handler = event_handler


class Shutdown(LaunchDescriptionEntity):
    """The end of all processes."""

    def __init__(self, *, reason: str) -> None:
        self.reason = reason
