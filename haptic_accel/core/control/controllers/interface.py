# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interface of controllers: parameters, one sample in and out, slow work between, a reset."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

from haptic_accel.core.actuator.guard import CUSHION
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.parameters import Checked


@dataclass(frozen=True)
class Loop:
    """Control loop that a controller is built for.

    Attributes
    ----------
    rate : float
        Samples per second.
    high_pass_frequency : float
        Corner of the high-pass that the desired acceleration has passed, Hz.
    plant : Plant
        Identified handle with everything between a command and a sample, latency included.
    travel : float
        Free travel of the actuator either way, m.
    """

    rate: float
    high_pass_frequency: float = HIGH_PASS_FREQUENCY
    plant: Plant = field(default_factory=Plant)
    travel: float = ActuatorParameters.travel

    @property
    def travel_limit(self) -> float:
        """Travel up to which a controller may plan, m: where the guard's cushion begins."""
        return CUSHION * self.travel

    @property
    def latency(self) -> int:
        """Samples from the one that caused a force to the tick at which the force is due."""
        return self.plant.latency


@dataclass(frozen=True)
class NoParameters(Checked):
    """The parameters of a controller that has none."""


class Controller(ABC):
    """Turns the desired handle acceleration into the actuator's force.

    A subclass names its parameter dataclass in `Parameters`; the compensator node declares
    the fields as ROS parameters below the controller's name.

    Parameters
    ----------
    parameters
        An instance of the class' `Parameters`.
    loop : Loop
    """

    Parameters: ClassVar[type[Checked]] = NoParameters

    @abstractmethod
    def __init__(self, parameters: Any, loop: Loop) -> None: ...

    @abstractmethod
    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Take one sample of desired and measured handle acceleration, return one force.

        Parameters
        ----------
        desired_acceleration : float
            High-passed tool acceleration, m/s^2.
        measured_acceleration : float
            The latest handle acceleration, m/s^2; NaN where it is stale, infinite where its
            sensor was at its range: it must not be used then.

        Returns
        -------
        float
            Actuator force, N, before the actuator's limit.
        """

    def applied(self, actuator_force: float) -> None:  # noqa: B027 - most need not know
        """Receive the force, N, finally sent at this sample: limited, or another controller's."""

    def adapt(self) -> None:  # noqa: B027 - most have none
        """Do a piece of slow work, some tens of microseconds, while no force is due."""

    def judged(self, fitting: float) -> None:  # noqa: B027 - most need not know
        """Receive for how long the handle's response has fitted the plant, s of excitation."""

    def freeze(self, frozen: bool) -> None:  # noqa: B027 - most have nothing to
        """Stop or resume adaptation."""

    def status(self) -> dict[str, str]:
        """Return values for diagnostics, by name with unit."""
        return {}

    @property
    def warning(self) -> str:
        """Present fault in words; empty for none."""
        return ""

    def reset(self) -> None:  # noqa: B027 - some have no state
        """Return to the state of a controller that has always seen zero."""
