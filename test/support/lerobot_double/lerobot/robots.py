# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

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
