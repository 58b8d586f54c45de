# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The three conditions of the paper: no compensation, constant gain, approximate inverse."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.control.controllers.interface import Controller, Loop, NoParameters
from haptic_accel.core.control.filters import inverse_of
from haptic_accel.core.model import ApproximateModel
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick.control import ConstantForce, FilterForce, Force


class NoController(Controller):
    """Zero force: position coupling alone, the paper's first condition."""

    needs_plant = False

    force = Force.force

    def __init__(self, parameters: NoParameters, loop: Loop) -> None: ...


@dataclass(frozen=True)
class ConstantParameters(Checked):
    """Parameters of `ConstantController`."""

    mass: float = parameter(
        0.128, "gain of the controller: mass of handle and hand (m_h of Table I)", unit="kg", low=0
    )


class ConstantController(ConstantForce, Controller):
    """f_a = m_h a_hdes: the handle is assumed to be a mass, the paper's second condition."""

    Parameters = ConstantParameters
    needs_plant = False

    def __init__(self, parameters: ConstantParameters, loop: Loop) -> None:
        super().__init__(parameters.mass)


class DynamicController(FilterForce, Controller):
    """Inverse of the approximate handle model, from a_hdes to f_a: the paper's third condition."""

    Parameters = ApproximateModel

    def __init__(self, parameters: ApproximateModel, loop: Loop) -> None:
        super().__init__(inverse_of(parameters, loop.rate))
