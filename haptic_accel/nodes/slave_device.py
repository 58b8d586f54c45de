# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `slave_device`: the arm whose tool touches the surface."""

from __future__ import annotations

from haptic_accel.core.topics import SLAVE
from haptic_accel.devices import SLAVES
from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.scheduling import run


class SlaveDevice(DeviceNode):
    """The device node of the slave."""

    def __init__(self) -> None:
        super().__init__("slave_device", SLAVES, SLAVE)


def main() -> None:
    """Run the node."""
    run("slave_device", SlaveDevice, join=join)


if __name__ == "__main__":
    main()
