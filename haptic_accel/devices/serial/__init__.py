# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Accelerometer, and at the master a voice coil, of a microcontroller on USB serial."""

from haptic_accel import lazy_names

__getattr__, __dir__ = lazy_names(__name__, __file__)
