# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controllers by name; a new one is a class in a separate file and a line here."""

from __future__ import annotations

from collections.abc import Mapping

from haptic_accel.core.control.controllers.adaptive import AdaptiveController
from haptic_accel.core.control.controllers.constant import ConstantController
from haptic_accel.core.control.controllers.dynamic import DynamicController
from haptic_accel.core.control.controllers.feedback import FeedbackController
from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.controllers.inverse import InverseController
from haptic_accel.core.control.controllers.none import NoController
from haptic_accel.core.parameters import Checked

CONTROLLERS: dict[str, type[Controller]] = {
    "none": NoController,
    "constant": ConstantController,
    "dynamic": DynamicController,
    "inverse": InverseController,
    "feedback": FeedbackController,
    "adaptive": AdaptiveController,
}


def granted_delay(controller: str, parameters: Mapping[str, Checked]) -> int:
    """Return the delay, in addition to the latency, for evaluating a controller, in samples.

    It is the controller's parameter of this name, or the paper's value if there is none.
    """
    own = parameters.get(controller)
    if own is None and controller in CONTROLLERS:
        own = CONTROLLERS[controller].Parameters()
    return int(getattr(own, "granted_delay", 1))


__all__ = ["CONTROLLERS", "Controller", "Loop", "granted_delay"]
