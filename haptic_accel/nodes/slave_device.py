"""Executable `slave_device`: the arm whose tool touches the surface."""

from __future__ import annotations

from typing import ClassVar

from haptic_accel.core import topics
from haptic_accel.devices import SLAVES
from haptic_accel.nodes.device_node import DeviceNode, changeable
from haptic_accel.nodes.scheduling import run


class SlaveDevice(DeviceNode):
    """The device node of the slave."""

    CHANGEABLE: ClassVar[tuple[str, ...]] = changeable(SLAVES)

    def __init__(self) -> None:
        super().__init__(
            "slave_device",
            SLAVES,
            topics.SLAVE_POSITION,
            topics.SLAVE_VELOCITY,
            topics.TOOL_ACCELERATION,
            topics.SLAVE_ARM_FORCE,
            topics.SLAVE_STOPPED,
        )


def main() -> None:
    """Run the node."""
    run("slave_device", SlaveDevice)


if __name__ == "__main__":
    main()
