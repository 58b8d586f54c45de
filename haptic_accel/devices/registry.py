# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices by name, from this package and from other packages.

To add a device to this package, add a file with its class, and an entry here.
"""

from __future__ import annotations

from haptic_accel.core.outside import with_outside
from haptic_accel.devices.audio import AUDIO
from haptic_accel.devices.can.device import CanMaster, CanSlave
from haptic_accel.devices.crtk.device import CrtkMaster, CrtkSlave
from haptic_accel.devices.interface import (
    MASTERS_GROUP,
    SLAVES_GROUP,
    CombinedDevice,
    CombinedTool,
    Device,
    combined,
    driver_problem,
)
from haptic_accel.devices.playback import ReplayMaster, ReplaySlave
from haptic_accel.devices.serial.device import SerialMaster, SerialSlave
from haptic_accel.devices.simulated import (
    PointerMaster,
    SimulatedMaster,
    SimulatedSlave,
    VirtualSlave,
)
from haptic_accel.devices.sound_bench import NO_ARM, NoArm

RESERVED = (AUDIO, "safety", "servo_cp", "topics")
"""Reserved names, which no device may have: other parts of a device node, and topics."""

_MASTERS: dict[str, type[Device]] = {
    "simulated": SimulatedMaster,
    "pointer": PointerMaster,
    "replay": ReplayMaster,
    "can": CanMaster,
    "serial": SerialMaster,
    "crtk": CrtkMaster,
    NO_ARM: NoArm,
}
_SLAVES: dict[str, type[Device]] = {
    "simulated": SimulatedSlave,
    "virtual": VirtualSlave,
    "replay": ReplaySlave,
    "can": CanSlave,
    "serial": SerialSlave,
    "crtk": CrtkSlave,
    NO_ARM: NoArm,
}
for _devices, _kind in ((_MASTERS, CombinedDevice), (_SLAVES, CombinedTool)):
    _devices["can_serial"] = combined(_devices, "can", "serial", _kind)
    _devices["crtk_serial"] = combined(_devices, "crtk", "serial", _kind)

MASTERS = with_outside(_MASTERS, MASTERS_GROUP, Device, driver_problem, RESERVED)
SLAVES = with_outside(_SLAVES, SLAVES_GROUP, Device, driver_problem, RESERVED)
