# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Values that are known when the launch runs."""

from __future__ import annotations

from launch import LaunchContext


class TextSubstitution:
    """Text that is known beforehand."""

    def __init__(self, *, text: str) -> None:
        self.text = text


class LaunchConfiguration:
    """Value of an argument."""

    def __init__(self, variable_name: str) -> None:
        self._name = variable_name

    def perform(self, context: LaunchContext) -> str:
        return context.launch_configurations[self._name]
