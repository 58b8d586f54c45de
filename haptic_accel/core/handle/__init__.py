# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Dynamics of the handle: its mechanics, responses, and the plant that a controller meets."""
