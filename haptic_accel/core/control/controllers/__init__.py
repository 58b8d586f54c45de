# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controllers by name, from this package and from other packages.

To add a controller to this package, add a file with its class, and a line here.
"""

from __future__ import annotations

from collections.abc import Mapping

from haptic_accel.core.control.controllers.adaptive import AdaptiveController
from haptic_accel.core.control.controllers.fixed import (
    ConstantController,
    DynamicController,
    FeedbackController,
    InverseController,
    InverseParameters,
    NoController,
)
from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.model import ACTUATOR
from haptic_accel.core.outside import parameters_problem, with_outside
from haptic_accel.core.parameters import Checked

CONTROLLERS_GROUP = "haptic_accel.controllers"
"""Group of entry points: controllers of other packages."""

PLANT = "plant"
"""Name of the identified plant among the controllers' parameters."""

RESERVED = (ACTUATOR, PLANT, "keep")
"""Names that no controller may have: other parts of the compensator, and `control`'s default."""

OWN_CONTROLLERS: dict[str, type[Controller]] = {
    "none": NoController,
    "constant": ConstantController,
    "dynamic": DynamicController,
    "inverse": InverseController,
    "feedback": FeedbackController,
    "adaptive": AdaptiveController,
}
CONTROLLERS = with_outside(
    OWN_CONTROLLERS,
    CONTROLLERS_GROUP,
    Controller,
    lambda kind, _: parameters_problem(kind.Parameters),
    RESERVED,
)


def granted_delay(controller: str, parameters: Mapping[str, Checked], rate: float) -> int:
    """Return the delay, in addition to the latency, for evaluating a controller, in samples.

    The paper's controllers do not wait: their delay is one sample, after which a force is first
    visible. The others have the parameter `granted_time`.

    Parameters
    ----------
    controller : str
    parameters : mapping
        Parameters of controllers by name; missing ones have their defaults.
    rate : float
        Samples per second.
    """
    own = parameters.get(controller)
    if own is None and controller in CONTROLLERS:
        own = CONTROLLERS[controller].Parameters()
    return own.granted_delay(rate) if isinstance(own, InverseParameters) else 1


__all__ = ["CONTROLLERS", "Controller", "Loop", "granted_delay"]
