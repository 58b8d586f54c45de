"""Executable `master_device`: the arm that the user holds, with the actuator in its handle."""

from __future__ import annotations

from typing import ClassVar

from haptic_accel.core import topics
from haptic_accel.devices import MASTERS
from haptic_accel.nodes.device_node import DeviceNode, changeable
from haptic_accel.nodes.scheduling import run


class MasterDevice(DeviceNode):
    """A device node that also applies the actuator's force.

    Parameters
    ----------
    first : bool
        Whether its tick gives no other the precedence.
    """

    CHANGEABLE: ClassVar[tuple[str, ...]] = changeable(MASTERS)

    def __init__(self, *, first: bool = True) -> None:
        super().__init__(
            "master_device",
            MASTERS,
            topics.MASTER_POSITION,
            topics.MASTER_VELOCITY,
            topics.HANDLE_ACCELERATION,
            topics.MASTER_ARM_FORCE,
            topics.MASTER_STOPPED,
            topics.ACTUATOR_FORCE,
            first=first,
        )


def main() -> None:
    """Run the node."""
    run("master_device", MasterDevice)


if __name__ == "__main__":
    main()
