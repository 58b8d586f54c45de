# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Actions that start nodes."""

from __future__ import annotations

from typing import Any

from launch import LaunchDescriptionEntity


class Node(LaunchDescriptionEntity):
    """A process with a node."""

    def __init__(self, **arguments: Any) -> None:
        self.arguments = arguments
