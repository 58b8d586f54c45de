# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Events of processes."""

from __future__ import annotations


class ProcessExited:
    """The end of a process."""
