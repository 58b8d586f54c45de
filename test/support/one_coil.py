# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compensation of a handle with one coil, fed with the components along it."""

from __future__ import annotations

from haptic_accel.core.axes import ACTUATOR_AXIS, along_actuator
from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.tick import ActuatorGuard


class OneCoil(Compensation):
    """Compensation of one coil."""

    def sample(self, tool: float, handle: float | None) -> tuple[float, float]:
        """Return desired acceleration, m/s^2, and force, N, along the coil."""
        felt = None if handle is None else along_actuator(handle)
        desired, force = self.process(along_actuator(tool), felt)
        return desired[ACTUATOR_AXIS], force[ACTUATOR_AXIS]

    @property
    def guard(self) -> ActuatorGuard:
        """Limits of the coil."""
        return self.channels[0].guard

    @property
    def supervisor(self) -> ResponseSupervisor:
        """Supervision of the coil."""
        return self.channels[0].supervisor

    @property
    def active(self) -> str:
        """Name of the controller whose force is used."""
        return self.channels[0].active.name
