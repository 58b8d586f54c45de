# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `slave_device`: the arm whose tool touches the surface."""

from __future__ import annotations

from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.scheduling import run_nodes


def build_slave_device() -> DeviceNode:
    """Return the device node of the slave."""
    return DeviceNode("slave_device")


def main() -> None:
    """Run the node."""
    run_nodes("slave_device", build_slave_device, join=join)


if __name__ == "__main__":
    main()
