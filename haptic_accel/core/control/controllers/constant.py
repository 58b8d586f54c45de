# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Constant gain: the handle is assumed to be a mass (the paper's second condition)."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.parameters import Checked, parameter


@dataclass(frozen=True)
class ConstantParameters(Checked):
    """Parameters of `ConstantController`."""

    mass: float = parameter(
        0.128, "gain of the controller: mass of handle and hand (m_h of Table I)", unit="kg", low=0
    )


class ConstantController(Controller):
    """f_a = m_h a_hdes."""

    Parameters = ConstantParameters

    def __init__(self, parameters: ConstantParameters, loop: Loop) -> None:
        self._mass = parameters.mass

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return mass times desired acceleration."""
        return self._mass * desired_acceleration
