# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accelerometer, and at the master a voice coil, of a microcontroller on USB serial."""
