# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parts of the loop: the same computations live and in lockstep, without clock or message."""
