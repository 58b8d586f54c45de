"""Executable `master_device`: the arm that the user holds, with the actuator in its handle."""

from __future__ import annotations

import math

from haptic_accel.core.coupling import Vector
from haptic_accel.devices import MASTERS
from haptic_accel.nodes import topics
from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.scheduling import run


class MasterDevice(DeviceNode):
    """A device node that also applies the actuator's force.

    Parameters
    ----------
    first : bool
        Whether its tick gives no other the precedence.
    """

    def __init__(self, *, first: bool = True) -> None:
        super().__init__(
            "master_device",
            MASTERS,
            topics.MASTER_POSITION,
            topics.MASTER_VELOCITY,
            topics.HANDLE_ACCELERATION,
            topics.MASTER_ARM_FORCE,
            first=first,
        )
        self._actuator_command = self.command()
        self._commands["actuator force"] = self._actuator_command
        self.listen(topics.ACTUATOR_FORCE, self._apply_actuator_force)

    def _quiet_the_silent(self, now: float) -> None:
        super()._quiet_the_silent(now)
        if self._actuator_command.went_silent(now):
            self.write(actuator_force=0.0)

    def _apply_actuator_force(self, moment: int, force: Vector) -> None:
        if not math.isfinite(force[2]):
            self._actuator_command.rejected += 1
            return
        self._actuator_command.applied(moment, self.write(actuator_force=force[2]))


def main() -> None:
    """Run the node."""
    run("master_device", MasterDevice)


if __name__ == "__main__":
    main()
