# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interface of controllers: parameters, processing of a sample, slow computations, reset."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, ClassVar

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.control.response_estimation import NEVER
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.parameters import Checked
from haptic_accel.core.tick import CUSHION, Force


@dataclass(frozen=True)
class Loop:
    """Control loop for which a controller is built.

    Attributes
    ----------
    rate : float
        Samples per second.
    high_pass_frequency : float
        Corner of the high-pass that filters the desired acceleration, Hz.
    plant : Plant
        Identified handle including the complete path from command to sample, with latency.
    travel : float
        Free travel of the actuator either way, m.
    clock : callable
        Steady time, s; constant in lockstep, where a computation may take any time.
    """

    rate: float
    high_pass_frequency: float = HIGH_PASS_FREQUENCY
    plant: Plant = field(default_factory=Plant)
    travel: float = ActuatorParameters.travel
    clock: Callable[[], float] = float

    @property
    def travel_limit(self) -> float:
        """Travel available to a controller's planning, m: up to the cushion of the guard."""
        return CUSHION * self.travel

    @property
    def latency(self) -> int:
        """Delay from sample to force, in samples."""
        return self.plant.latency


@dataclass(frozen=True)
class NoParameters(Checked):
    """Parameters of a controller without parameters."""


class Controller(Force, ABC):
    """Convert the desired handle acceleration to the actuator's force.

    A subclass names its parameter dataclass in `Parameters`; the compensator node declares
    the fields as ROS parameters below the controller's name. It may also have `applied`, which
    receives the force that is sent in a sample, N, and `reset`, which clears its state.

    Parameters
    ----------
    parameters
        An instance of the class' `Parameters`.
    loop : Loop
    """

    Parameters: ClassVar[type[Checked]] = NoParameters

    reducible: ClassVar[bool] = False
    """True if the force is reduced while it is worse than no force, and if it cancels the steps of
    the arm's encoders. The paper's controllers are used unchanged, or replaced."""

    needs_plant: ClassVar[bool] = True
    """True if the force depends on the loop's plant."""

    failure: str = ""
    """Reason why `none` has to take over; empty if there is none."""

    @abstractmethod
    def __init__(self, parameters: Any, loop: Loop) -> None: ...

    @abstractmethod
    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Process a sample of desired and measured handle acceleration; return the force.

        Parameters
        ----------
        desired_acceleration : float
            High-passed tool acceleration, m/s^2.
        measured_acceleration : float
            Latest handle acceleration, m/s^2. It must not be used if it is NaN (stale) or infinite
            (sensor saturated).

        Returns
        -------
        float
            Actuator force, N, before the actuator's limit.
        """

    def adapt(self) -> int | None:
        """Execute a part of the slow computations, tens of microseconds, while no force is due.

        Returns
        -------
        int or None
            Number of samples until the next part; None stands for the next sample.
        """
        return NEVER

    def judged(self, fitting: float, fraction: float) -> None:
        """Receive a new result of the supervision.

        Parameters
        ----------
        fitting : float
            Time for which the response has fitted the plant, s of excitation.
        fraction : float
            Fraction of the controller's force that does not increase the error, from 0 to 1.
        """

    def freeze(self, frozen: bool) -> None:
        """Stop or resume adaptation."""

    def diagnostics(self) -> dict[str, str]:
        """Return values for diagnostics, by name with unit."""
        return {}

    @property
    def warning(self) -> str:
        """Description of a present fault; empty if there is none."""
        return ""
