# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exports of bags to the formats of other programs: LeRobot, Parquet, HDF5, CSV, sound."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
