# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from haptic_accel.kits.export.lerobot import LeRobotWriter as LeRobotWriter
