# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controller of another package, which may fail or take too long."""

from __future__ import annotations

import math
from collections.abc import Callable
from numbers import Real
from typing import Any

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.outside import OutsideError, guard

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
