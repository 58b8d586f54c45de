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
