# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Arms without hardware for LeRobot or its double: a leader and a follower.

A leader or follower that is broken fails to disconnect.
"""

from dataclasses import dataclass
from typing import Any

from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig


class Arm:
    """What leader and follower have in common: a joint, and a record of the calls."""

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.broken = config.broken
        self.calls: list[Any] = []
        self.linked = False

    @property
    def action_features(self) -> dict[str, Any]:
        return {"joint.pos": float}

    @property
    def is_connected(self) -> bool:
        return self.linked

    @property
    def is_calibrated(self) -> bool:
        return "calibrate" in self.calls

    def connect(self, calibrate: bool = True) -> None:
        self.calls.append(("connect", calibrate))
        self.linked = True

    def calibrate(self) -> None:
        self.calls.append("calibrate")

    def configure(self) -> None:
        self.calls.append("configure")

    def disconnect(self) -> None:
        self.linked = False
        self.calls.append("disconnect")
        if self.broken:
            raise ConnectionError("the arm is gone")


@TeleoperatorConfig.register_subclass("plain_leader")
@dataclass(kw_only=True)
class PlainLeaderConfig(TeleoperatorConfig):
    broken: bool = False


class PlainLeader(Arm, Teleoperator):
    config_class = PlainLeaderConfig
    name = "plain_leader"

    @property
    def feedback_features(self) -> dict[str, Any]:
        return {"joint.force": float}

    def get_action(self) -> dict[str, Any]:
        return {"joint.pos": 0.25}

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        self.calls.append(feedback)


@RobotConfig.register_subclass("plain_follower")
@dataclass(kw_only=True)
class PlainFollowerConfig(RobotConfig):
    broken: bool = False


class PlainFollower(Arm, Robot):
    config_class = PlainFollowerConfig
    name = "plain_follower"

    @property
    def observation_features(self) -> dict[str, Any]:
        return {"joint.pos": float}

    def get_observation(self) -> dict[str, Any]:
        return {"joint.pos": 0.5}

    def send_action(self, action: dict[str, Any]) -> dict[str, Any]:
        self.calls.append(action)
        return {"joint.pos": 0.75}
