# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `master_device`: the arm that the user holds, with the actuator in its handle."""

from __future__ import annotations

from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.scheduling import run_nodes


def build_master_device() -> DeviceNode:
    """Return the device node of the master, which also applies the actuator's force."""
    return DeviceNode("master_device")


def main() -> None:
    """Run the node."""
    run_nodes("master_device", build_master_device, join=join)


if __name__ == "__main__":
    main()
