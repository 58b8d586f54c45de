# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

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
