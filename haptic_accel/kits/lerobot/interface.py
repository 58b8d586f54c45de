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

"""The part of LeRobot's interface that the plug-ins use; nothing else here depends on it.

Read from release 0.6.1, which changes it without notice. Beyond these members, the two
distributions in ``plugins`` use:

- ``lerobot.teleoperators``: ``Teleoperator``, ``TeleoperatorConfig.register_subclass``,
  ``make_teleoperator_from_config``;
- ``lerobot.robots``: ``Robot``, ``RobotConfig.register_subclass``, ``make_robot_from_config``;
- the rule by which ``lerobot.utils.import_utils`` finds a plug-in: a distribution named
  ``lerobot_teleoperator_*`` or ``lerobot_robot_*`` is imported as a module of that name, whose
  device class is named as its class of configuration without ``Config``.
"""

from __future__ import annotations

from typing import Any, Protocol


class Wrapped(Protocol):
    """Members that leaders and followers have in common."""

    @property
    def action_features(self) -> dict[str, Any]:
        """Keys of an action, with their types."""

    @property
    def is_connected(self) -> bool:
        """True while the device may be used."""

    @property
    def is_calibrated(self) -> bool:
        """True if no calibration is needed."""

    def connect(self, calibrate: bool = True) -> None:
        """Connect, and calibrate if needed and asked for."""

    def calibrate(self) -> None:
        """Calibrate the motors."""

    def configure(self) -> None:
        """Set up the motors."""

    def disconnect(self) -> None:
        """Disconnect."""


class Leader(Wrapped, Protocol):
    """Members of a teleoperator."""

    @property
    def feedback_features(self) -> dict[str, Any]:
        """Keys of feedback, with their types."""

    def get_action(self) -> dict[str, Any]:
        """Return the present action."""

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Apply feedback."""


class Follower(Wrapped, Protocol):
    """Members of a robot; one with cameras also has `cameras`, of which only the number counts."""

    @property
    def observation_features(self) -> dict[str, Any]:
        """Keys of an observation: `float` for a number, height, width and channels of an image."""

    def get_observation(self) -> dict[str, Any]:
        """Return the present observation."""

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        """Move the motors; return the action that was sent."""
