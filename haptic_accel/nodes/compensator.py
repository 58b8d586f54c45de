"""Executable `compensator`: from the tool's acceleration to the force of the actuator."""

from __future__ import annotations

import time

# Loaded here so that it is there when the node appears to others: designing a filter needs it.
import scipy.signal  # noqa: F401

from haptic_accel.core.compensation import Compensation
from haptic_accel.core.coupling import ZERO, Vector
from haptic_accel.nodes import topics
from haptic_accel.nodes.interface import GraphNode
from haptic_accel.nodes.scheduling import NANOSECONDS, run


class Compensator(GraphNode):
    """Every tool acceleration causes one force, published before anything else."""

    def __init__(self) -> None:
        super().__init__("compensator")
        p = self.parameters
        self._compensation = Compensation(p, p.rate, self.options)
        self._period = NANOSECONDS / p.rate
        self._handle_acceleration = 0.0
        self._last: int | None = None
        self._samples = self._lost = self._stale = 0
        self._send_force = self.sender(topics.ACTUATOR_FORCE).send
        self._send_desired = self.sender(topics.DESIRED_ACCELERATION).send
        self.listen(topics.TOOL_ACCELERATION, self._compensate)
        self.listen(topics.HANDLE_ACCELERATION, self._keep)

    def close(self) -> None:
        """Leave the actuator without force."""
        self._send_force(time.time_ns(), ZERO)
        super().close()

    def status(self) -> tuple[str, dict[str, str]]:
        """Return what was lost, cut and refused."""
        return "", {
            "controller": self.parameters.controller,
            "samples": str(self._samples),
            "lost": str(self._lost),
            "out of order": str(self._stale),
            "saturated": str(self._compensation.saturated),
            "rejected": str(self._compensation.rejected),
        }

    def _keep(self, moment: int, acceleration: Vector) -> None:
        self._handle_acceleration = acceleration[2]

    def _compensate(self, moment: int, acceleration: Vector) -> None:
        if not self._in_order(moment):
            return
        desired, force = self._compensation.sample(acceleration[2], self._handle_acceleration)
        self._send_force(moment, (0.0, 0.0, force))
        self._send_desired(moment, (0.0, 0.0, desired))

    def _in_order(self, moment: int) -> bool:
        """Count samples; false for one that is not newer than the last."""
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
