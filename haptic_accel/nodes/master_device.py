"""Executable `master_device`: the arm that the user holds, with the actuator in its handle."""

from __future__ import annotations

from haptic_accel.core.topics import MASTER
from haptic_accel.devices import MASTERS
from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.scheduling import run


class MasterDevice(DeviceNode):
    """The device node of the master, which also applies the actuator's force."""

    def __init__(self) -> None:
        super().__init__("master_device", MASTERS, MASTER)


def main() -> None:
    """Run the node."""
    run("master_device", MasterDevice)


if __name__ == "__main__":
    main()
