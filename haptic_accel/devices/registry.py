# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices by name, from this package and from other packages.

To add a device to this package, add a file with its class, and an entry here.
"""

from __future__ import annotations

from haptic_accel.core.outside import with_outside
from haptic_accel.devices import audio, interface, playback, simulated, sound_bench
from haptic_accel.devices.can.device import CanMaster, CanSlave
from haptic_accel.devices.interface import Device, combined, driver_problem
from haptic_accel.devices.serial.device import SerialMaster, SerialSlave

RESERVED = (audio.AUDIO, "safety", "servo_cp", "topics")
"""Reserved names, which no device may have: other parts of a device node, and topics."""

_MASTERS: dict[str, type[Device]] = {
    "simulated": simulated.SimulatedMaster,
    "pointer": simulated.PointerMaster,
    "replay": playback.ReplayMaster,
    "can": CanMaster,
    "serial": SerialMaster,
    sound_bench.NO_ARM: sound_bench.NoArm,
}
_SLAVES: dict[str, type[Device]] = {
    "simulated": simulated.SimulatedSlave,
    "virtual": simulated.VirtualSlave,
    "replay": playback.ReplaySlave,
    "can": CanSlave,
    "serial": SerialSlave,
    sound_bench.NO_ARM: sound_bench.NoArm,
}
_MASTERS["can_serial"] = combined(_MASTERS, "can", "serial")
_SLAVES["can_serial"] = combined(_SLAVES, "can", "serial", interface.CombinedTool)

MASTERS = with_outside(_MASTERS, interface.MASTERS_GROUP, Device, driver_problem, RESERVED)
SLAVES = with_outside(_SLAVES, interface.SLAVES_GROUP, Device, driver_problem, RESERVED)
