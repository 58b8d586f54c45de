# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parts of the control loop, without clock or messages; used live and in lockstep."""
