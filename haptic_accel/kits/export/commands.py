# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Heading and summary of the command ``haptic-accel export``."""

from __future__ import annotations

from haptic_accel.commands import KitVerb

VERB = KitVerb(
    "Recording and analysis",
    "write bags as LeRobot, Parquet, HDF5, CSV or sound",
    "haptic_accel.kits.export.command_line",
)
