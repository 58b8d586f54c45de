"""Executable `compensator`: from the tool's acceleration to the force of the actuator."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

# Loaded now, so that it is there when other nodes see this one: designing a filter needs it.
import scipy.signal  # noqa: F401
from std_srvs.srv import Trigger

from haptic_accel.core import topics
from haptic_accel.core.control.compensation import Compensation
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.topics import ACTUATOR_AXIS, along_actuator
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import run

FROZEN = "adaptive.frozen"
"""Parameter that stops the adaptation."""

KEPT = 4
"""Number of handle samples kept to find the one of the previous tick."""


class Compensator(GraphNode):
    """Every tool acceleration causes one force, published before anything else."""

    def __init__(self) -> None:
        super().__init__("compensator", ("controller", FROZEN))
        p = self.parameters
        # All of them: designing one takes longer than a force may wait.
        self._compensation = Compensation(p, p.rate, self.options, tuple(CONTROLLERS))
        self._period = NANOSECONDS / p.rate
        self._handle: deque[tuple[int, float]] = deque(maxlen=KEPT)
        self._last: int | None = None
        self._samples = self._lost = self._stale = 0
        self._send_force = self.sender(topics.ACTUATOR_FORCE).send
        self._send_desired = self.sender(topics.DESIRED_ACCELERATION).send
        self.listen(topics.TOOL_ACCELERATION, self._compensate)
        self.listen(topics.HANDLE_ACCELERATION, self._keep)
        self.create_service(Trigger, "~/reset", self._reset)

    def close(self) -> None:
        """Leave the actuator without force."""
        self._send_force(time.time_ns(), ZERO)
        super().close()

    def change(self, values: dict[str, Any]) -> None:
        """Switch the controller, or stop or resume adaptation."""
        if FROZEN in values:
            self._compensation.freeze(values[FROZEN])
        if "controller" in values:
            self._compensation.select(values["controller"])

    def status(self) -> tuple[str, dict[str, str]]:
        """Return counts of lost, limited and refused samples, and the controller's values."""
        warning, values = self._compensation.status()
        return warning, {
            "samples": str(self._samples),
            "lost": str(self._lost),
            "out of order": str(self._stale),
            **values,
        }

    def _keep(self, moment: int, acceleration: Vector) -> None:
        self._handle.append((moment, acceleration[ACTUATOR_AXIS]))

    def _compensate(self, moment: int, acceleration: Vector) -> None:
        if not self._in_order(moment):
            return
        desired, force = self._compensation.sample(
            acceleration[ACTUATOR_AXIS], self._before(moment)
        )
        self._send_force(moment, along_actuator(force))
        self._send_desired(moment, along_actuator(desired))
        self._compensation.adapt()

    def _before(self, moment: int) -> float | None:
        """Return the handle's acceleration of the tick before a moment, if it was received."""
        wanted = moment - self._period
        for received, acceleration in reversed(self._handle):
            if abs(received - wanted) < self._period / 2:
                return acceleration
        return None

    def _reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Reset all controllers: filters and grip estimates."""
        self._compensation.reset()
        response.success = True
        return response

    def _in_order(self, moment: int) -> bool:
        """Count a sample; return whether it is newer than the last."""
        if self._last is not None:
            steps = round((moment - self._last) / self._period)
            if steps < 1:
                self._stale += 1
                return False
            self._lost += steps - 1
        self._last = moment
        self._samples += 1
        return True


def main() -> None:
    """Run the node."""
    run("compensator", Compensator)


if __name__ == "__main__":
    main()
