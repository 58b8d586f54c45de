# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""An accelerometer, and at the master a voice coil, behind a microcontroller on USB serial."""
