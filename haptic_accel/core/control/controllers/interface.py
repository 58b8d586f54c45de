# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Interface of controllers: parameters, a sample, slow computations, reset; guard of foreign ones.

A controller of another package may fail or take too long.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, ClassVar

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.estimation import NEVER
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.outside import OutsideError, guard
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


FADING = 5e-3
"""Duration of the fade-out of a failed controller's last force, s, as between two controllers."""

SHARE = 0.5
"""Maximum fraction of a sample's time for a controller's own computations: at the highest rates
that are sustained, all other parts of a tick take up to half."""

WINDOW, WINDOWS, LOOK = 0.05, 5, 10
"""Averaging time of this fraction, s; number of successive averages that must exceed the limit, as
the computer itself may stall in some of them; and number of samples between checks."""

NO_FORCE = "returned {}, which is not a finite number"
"""Reason to replace a controller that returned a non-finite force."""


class ForeignController(Controller):
    """Controller of another package; after a failure its last force fades out, until a reset.

    It fails if it raises an exception, returns no finite number, or is too slow by the loop's
    clock.

    Parameters
    ----------
    name : str
    controller : Controller
    loop : Loop
    """

    def __init__(self, name: str, controller: Controller, loop: Loop) -> None:
        self._name, self._controller = name, controller
        self._clock, self._rate = loop.clock, loop.rate
        self._fading = max(1, round(FADING * loop.rate))
        self._begin()

    def _begin(self) -> None:
        self.failure = ""
        self._last, self._left = 0.0, 0
        self._samples, self._spent, self._exceeded = 0, 0.0, 0

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the controller's force, or the fading last force after a failure."""
        self._samples += 1
        result = self._call(self._controller.force, desired_acceleration, measured_acceleration)
        if isinstance(result, Real) and math.isfinite(result):
            self._last, self._left = float(result), self._fading
            return self._last
        if not self.failure:
            kind = result if isinstance(result, float) else type(result).__name__
            self._fail(NO_FORCE.format(kind))
        self._left = max(0, self._left - 1)
        return self._last * self._left / self._fading

    def applied(self, actuator_force: float) -> None:
        """Forward the force that is sent."""
        self._call(self._controller.applied, actuator_force)

    def reset(self) -> None:
        """Return to the initial state and clear a failure."""
        self._begin()
        self._call(self._controller.reset)

    def adapt(self) -> int:
        """Execute a part of the controller's slow computations, and check its computing time."""
        adapt = self._controller.adapt
        left: int = self._call(lambda: min(adapt() or 1, LOOK)) or 1
        period = 1.0 / self._rate
        if max(self._samples * period, self._spent) >= WINDOW:
            spent = self._spent / self._samples
            self._samples, self._spent = 0, 0.0
            self._exceeded = self._exceeded + 1 if spent > SHARE * period else 0
            if self._exceeded == WINDOWS:
                self._fail(f"took {1e6 * spent:.0f} us of the {1e6 * period:.0f} us of a sample")
        return left

    def judged(self, fitting: float, fraction: float) -> None:
        """Forward a new result of the supervision."""
        self._call(self._controller.judged, fitting, fraction)

    def freeze(self, frozen: bool) -> None:
        """Stop or resume adaptation."""
        self._call(self._controller.freeze, frozen)

    def diagnostics(self) -> dict[str, str]:
        """Return the controller's values for diagnostics."""
        own = self._controller
        found = self._call(lambda: {str(key): str(it) for key, it in own.diagnostics().items()})
        return found or {}

    @property
    def warning(self) -> str:
        """Description of a present fault; `failure` describes a failure."""
        return self._call(lambda: str(self._controller.warning)) or ""

    def _call(self, act: Callable[..., Any], *arguments: Any) -> Any:
        """Call a part of the controller; return None once it has failed."""
        if self.failure:
            return None
        started, result = self._clock(), None
        try:
            with guard():
                result = act(*arguments)
        except OutsideError as error:
            self._fail(f"raised {error}")
        self._spent += self._clock() - started
        return result

    def _fail(self, reason: str) -> None:
        self.failure = replaced(self._name, reason)


def replaced(name: str, reason: str) -> str:
    """Return the message on a controller that was replaced for a reason."""
    return f"controller {name}: {reason}; none took over"
