"""The controllers by name. A new one is a class in a file of its own and a line here."""

from __future__ import annotations

from haptic_accel.core.control.controllers.adaptive import AdaptiveController
from haptic_accel.core.control.controllers.constant import ConstantController
from haptic_accel.core.control.controllers.dynamic import DynamicController
from haptic_accel.core.control.controllers.feedback import FeedbackController
from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.controllers.inverse import InverseController
from haptic_accel.core.control.controllers.none import NoController

CONTROLLERS: dict[str, type[Controller]] = {
    "none": NoController,
    "constant": ConstantController,
    "dynamic": DynamicController,
    "inverse": InverseController,
    "feedback": FeedbackController,
    "adaptive": AdaptiveController,
}

__all__ = ["CONTROLLERS", "Controller", "Loop"]
