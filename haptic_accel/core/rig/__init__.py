# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The simulated rig: its mechanics, its instruments and the hand that explores with it."""
