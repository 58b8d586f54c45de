# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bring-up of a rig in five steps: connect, calibrate, make safe, identify, prove."""

from haptic_accel.commands import KitVerb

VERB = KitVerb(
    "Devices",
    "bring up a rig in five steps, and write its parameter file",
    "haptic_accel.kits.bringup.command_line",
)
