# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from haptic_accel.kits.textures.building import Recording as Recording, build as build
from haptic_accel.kits.textures.command_line import described as described
