# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""LeRobot plug-in: a follower arm whose observation has its gripper's vibration."""

from dataclasses import dataclass

from lerobot.robots import Robot, RobotConfig, make_robot_from_config

from haptic_accel.kits.lerobot import VibrationRobot, others, wrapped

NAME = "haptic_accel"
"""Type in LeRobot's configuration."""

Follower = others(RobotConfig, NAME)


@RobotConfig.register_subclass(NAME)
@dataclass(kw_only=True)
class HapticAccelRobotConfig(RobotConfig):
    """Configuration: the follower, the arguments of the fast path, and LeRobot's frame rate."""

    follower: Follower
    arguments: str = ""
    fps: int = 30


class HapticAccelRobot(VibrationRobot, Robot):
    """Any robot of LeRobot, and the vibration of its gripper."""

    config_class = HapticAccelRobotConfig
    name = NAME

    def __init__(self, config: HapticAccelRobotConfig) -> None:
        follower = wrapped(make_robot_from_config, config.follower, "robot.follower")
        VibrationRobot.__init__(self, follower, config.arguments, config.fps)
        Robot.__init__(self, config)
