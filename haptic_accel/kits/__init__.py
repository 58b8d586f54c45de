# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Kits: optional features for some users, each in a folder that can be removed."""
