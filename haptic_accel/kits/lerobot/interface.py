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

Read from release 0.6.1; each release may change it. Beyond the members below, the two
distributions in ``plugins`` use:

- ``lerobot.teleoperators``: ``Teleoperator``, ``TeleoperatorConfig.register_subclass``,
  ``make_teleoperator_from_config``;
- ``lerobot.robots``: ``Robot``, ``RobotConfig.register_subclass``, ``make_robot_from_config``;
- the choices of a configuration, from draccus: `others`;
- the rule by which ``lerobot.utils.import_utils`` finds a plug-in: a distribution named
  ``lerobot_teleoperator_*`` or ``lerobot_robot_*`` is imported as a module of that name, whose
  device class is named as its class of configuration without ``Config``.
"""

from __future__ import annotations

from typing import Any


class PassedOn:
    """Attribute or method that is the wrapped device's own."""

    def __set_name__(self, owner: type, name: str) -> None:
        """Take the name in the class."""
        self._name = name

    def __get__(self, device: Any, owner: type) -> Any:
        """Return the attribute of the wrapped device."""
        return self if device is None else getattr(device.wrapped, self._name)


class WrappedArm:
    """Members that teleoperators and robots have in common.

    `haptic_accel.kits.lerobot.wrapping` adds to ``is_connected``, ``connect(calibrate)`` and
    ``disconnect``.

    Attributes
    ----------
    wrapped
        Device of LeRobot.
    """

    wrapped: Any

    action_features = PassedOn()
    is_calibrated = PassedOn()
    calibrate = PassedOn()
    configure = PassedOn()


class WrappedTeleoperator(WrappedArm):
    """Members of a teleoperator; `FeltTeleoperator` adds to ``get_action``."""

    feedback_features = PassedOn()
    send_feedback = PassedOn()


class WrappedRobot(WrappedArm):
    """Members of a robot; `VibrationRobot` adds to the others.

    These are ``observation_features``, of which `float` is a number, ``get_observation``, and
    ``cameras``, which not every robot has.
    """

    send_action = PassedOn()


CHOICE = "get_choice_class", "get_choice_name", "default_choice_name"
"""Members of a choice of configurations, in addition to `get_known_choices`."""


def others(registry: Any, own: str) -> Any:
    """Return the choice among the configurations of a registry except one, as a field's type.

    The field of a configuration that is among the field's own choices would be expanded without
    end, for every program of LeRobot.
    """

    def known() -> dict[str, Any]:
        return {name: each for name, each in registry.get_known_choices().items() if name != own}

    members = {name: getattr(registry, name) for name in CHOICE}
    return type("Others", (), {**members, "get_known_choices": staticmethod(known)})
