# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Inverse of the approximate handle model (the paper's third condition)."""

from __future__ import annotations

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.filters import SampleFilter, inverse_of
from haptic_accel.core.model import ApproximateModel


class DynamicController(Controller):
    """f_a = a_hdes through the inverse of the paper's approximate model."""

    Parameters = ApproximateModel

    def __init__(self, parameters: ApproximateModel, loop: Loop) -> None:
        self._inverse = SampleFilter(inverse_of(parameters, loop.rate))

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force that makes the model accelerate as desired."""
        return self._inverse.sample(desired_acceleration)

    def reset(self) -> None:
        """Clear the filter."""
        self._inverse.reset()
