# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Heading and summary of the command ``haptic-accel bringup``."""

from __future__ import annotations

from haptic_accel.commands import KitVerb

VERB = KitVerb(
    "Devices",
    "bring up a rig in five steps, and write its parameter file",
    "haptic_accel.kits.bringup.command_line",
)
