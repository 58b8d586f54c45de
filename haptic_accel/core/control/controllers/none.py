# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""No compensation: position coupling alone, the paper's first condition."""

from __future__ import annotations

from haptic_accel.core.control.controllers.interface import Controller, Loop, NoParameters


class NoController(Controller):
    """Zero force."""

    def __init__(self, parameters: NoParameters, loop: Loop) -> None: ...

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return zero."""
        return 0.0
