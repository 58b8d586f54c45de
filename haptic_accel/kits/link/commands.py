# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Heading and summary of the command ``haptic-accel keys``."""

from __future__ import annotations

from haptic_accel.commands import KitVerb

VERB = KitVerb("Machine", "make keys for two hosts", "haptic_accel.kits.link.keys")
