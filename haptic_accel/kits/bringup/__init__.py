# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bring-up of a rig in five steps: connect, calibrate, make safe, identify, prove."""
