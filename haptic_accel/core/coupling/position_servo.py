# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Position control of one arm for CRTK's commands `servo_cp` and `hold`."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import Checked, parameter


@dataclass(frozen=True)
class PositionServoParameters(Checked):
    """Gains of an arm's position control; the safety layer limits its force."""

    stiffness: float = parameter(
        250.0, "stiffness towards a commanded position: that of the coupling", "N/m", 0, 5000.0
    )
    # The simulated slave has 60 g, and 3 N s/m in its joints.
    damping: float = parameter(
        4.0, "damping of commanded positions (0.9 of critical in simulation)", "N s/m", 0, 50.0
    )


class PositionServo:
    """Spring and damper to a set-point; inactive without a set-point.

    Parameters
    ----------
    parameters : PositionServoParameters

    Attributes
    ----------
    set_point : tuple of float or None
        Commanded position, m; None while no position is commanded.

    Examples
    --------
    >>> servo = PositionServo(PositionServoParameters(stiffness=100.0, damping=2.0))
    >>> servo.set_point = (0.01, 0.0, 0.0)
    >>> servo.force((0.0, 0.0, 0.0), (0.1, 0.0, 0.0))
    (0.8, 0.0, 0.0)
    """

    def __init__(self, parameters: PositionServoParameters) -> None:
        self._parameters = parameters
        self.set_point: Vector | None = None

    def force(self, position: Vector, velocity: Vector) -> Vector | None:
        """Return the force, N, for a position, m, and velocity, m/s; None without a set-point."""
        if self.set_point is None:
            return None
        p = self._parameters
        x, y, z = (
            p.stiffness * (goal - coordinate) - p.damping * speed
            for goal, coordinate, speed in zip(self.set_point, position, velocity, strict=True)
        )
        return x, y, z
