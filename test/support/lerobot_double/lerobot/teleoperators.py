# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Double of ``lerobot.teleoperators``."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

from lerobot.registry import Config, Device, make_device


@dataclass(kw_only=True)
class TeleoperatorConfig(Config):
    choices: ClassVar[dict[str, type]] = {}


class Teleoperator(Device):
    config_class: type[TeleoperatorConfig]
    name: str

    @property
    @abstractmethod
    def feedback_features(self) -> dict[str, Any]: ...

    @abstractmethod
    def get_action(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_feedback(self, feedback: dict[str, Any]) -> None: ...


make_teleoperator_from_config = make_device
