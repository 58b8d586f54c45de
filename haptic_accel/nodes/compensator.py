"""Executable `compensator`: from the tool's acceleration to the force of the actuator."""

from __future__ import annotations

import time
from typing import Any

# Loaded here so that it is there when the node appears to others: designing a filter needs it.
import scipy.signal  # noqa: F401
from geometry_msgs.msg import AccelStamped, WrenchStamped

from haptic_accel.core.compensation import Compensation
from haptic_accel.nodes import topics
from haptic_accel.nodes.interface import GraphNode, stamp, stamp_of
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
        self._force = WrenchStamped()
        self._force.header.frame_id = topics.ACTUATOR_FORCE.frame
        self._desired = AccelStamped()
        self._desired.header.frame_id = topics.DESIRED_ACCELERATION.frame
        self._publish_force = self.publisher(topics.ACTUATOR_FORCE).publish
        self._publish_desired = self.publisher(topics.DESIRED_ACCELERATION).publish
        self.subscribe(topics.TOOL_ACCELERATION, self._compensate)
        self.subscribe(topics.HANDLE_ACCELERATION, self._keep)

    def close(self) -> None:
        """Leave the actuator without force."""
        self._send(0.0, time.time_ns())

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

    def _keep(self, message: Any) -> None:
        self._handle_acceleration = message.accel.linear.z

    def _compensate(self, message: Any) -> None:
        moment = stamp_of(message)
        if not self._in_order(moment):
            return
        desired, force = self._compensation.sample(
            message.accel.linear.z, self._handle_acceleration
        )
        self._send(force, moment)
        stamp(self._desired, moment)
        self._desired.accel.linear.z = desired
        self._publish_desired(self._desired)

    def _send(self, force: float, moment: int) -> None:
        stamp(self._force, moment)
        self._force.wrench.force.z = force
        self._publish_force(self._force)

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
    run(Compensator, "compensator")


if __name__ == "__main__":
    main()
