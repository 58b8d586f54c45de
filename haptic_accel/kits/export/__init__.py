# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exports of bags to the formats of other programs: LeRobot, Parquet, HDF5, CSV, sound."""

from haptic_accel import lazy_names
from haptic_accel.commands import KitVerb

__getattr__, __dir__ = lazy_names(__name__, __file__)

VERB = KitVerb(
    "Recording and analysis",
    "write bags as LeRobot, Parquet, HDF5, CSV or sound",
    "haptic_accel.kits.export.command_line",
)
