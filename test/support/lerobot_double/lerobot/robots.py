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

"""Double of ``lerobot.robots``."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from lerobot.registry import Config, Device, make_device


@dataclass(kw_only=True)
class RobotConfig(Config):
    choices: ClassVar[dict[str, type]] = {}


class Robot(Device):
    config_class: type[RobotConfig]
    name: str

    def __init__(self, config: RobotConfig) -> None:
        super().__init__(config)
        self.robot_type = self.name

    @property
    @abstractmethod
    def observation_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def get_observation(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]: ...


make_robot_from_config = make_device
