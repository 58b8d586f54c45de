# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""LeRobot plug-in: a leader arm in whose handle the follower's gripper is felt."""

from dataclasses import dataclass

from lerobot.teleoperators import Teleoperator, TeleoperatorConfig, make_teleoperator_from_config

from haptic_accel.kits.lerobot import FeltTeleoperator, others, wrapped

NAME = "haptic_accel"
"""Type in LeRobot's configuration."""

Leader = others(TeleoperatorConfig, NAME)


@TeleoperatorConfig.register_subclass(NAME)
@dataclass(kw_only=True)
class HapticAccelTeleoperatorConfig(TeleoperatorConfig):
    """Configuration: the leader, and the arguments of the fast path."""

    leader: Leader
    arguments: str = ""


class HapticAccelTeleoperator(FeltTeleoperator, Teleoperator):
    """Any teleoperator of LeRobot, and the coil in its handle."""

    config_class = HapticAccelTeleoperatorConfig
    name = NAME

    def __init__(self, config: HapticAccelTeleoperatorConfig) -> None:
        leader = wrapped(make_teleoperator_from_config, config.leader, "teleop.leader")
        FeltTeleoperator.__init__(self, leader, config.arguments)
        Teleoperator.__init__(self, config)
