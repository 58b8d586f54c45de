# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `master_device`: the arm that the user holds, with the actuator in its handle."""

from __future__ import annotations

from haptic_accel.core.topics import MASTER
from haptic_accel.devices import MASTERS, Device
from haptic_accel.devices.audio import AUDIO, AudioActuator
from haptic_accel.nodes.device_node import DeviceNode
from haptic_accel.nodes.loop_runner import join
from haptic_accel.nodes.scheduling import run


class MasterDevice(DeviceNode):
    """The device node of the master, which also applies the actuator's force."""

    def __init__(self) -> None:
        super().__init__("master_device", MASTERS, MASTER)

    def _build_device(self) -> Device:
        p, device = self.parameters, super()._build_device()
        if p.actuator_device != AUDIO:
            return device
        return AudioActuator(self.options[AUDIO], p.rate, device, p.latency)


def main() -> None:
    """Run the node."""
    run("master_device", MasterDevice, join=join)


if __name__ == "__main__":
    main()
