# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices by name. A new one is a class in a file of its own and a line here."""

from __future__ import annotations

from haptic_accel.devices.can.device import CanMaster, CanSlave
from haptic_accel.devices.combined import combined
from haptic_accel.devices.crtk.device import CrtkMaster, CrtkSlave
from haptic_accel.devices.interface import Device, DeviceError, Sample
from haptic_accel.devices.playback import ReplayMaster, ReplaySlave
from haptic_accel.devices.serial.device import SerialMaster, SerialSlave
from haptic_accel.devices.simulated import PointerMaster, SimulatedMaster, SimulatedSlave
from haptic_accel.devices.virtual import VirtualSlave

MASTERS: dict[str, type[Device]] = {
    "simulated": SimulatedMaster,
    "pointer": PointerMaster,
    "replay": ReplayMaster,
    "can": CanMaster,
    "serial": SerialMaster,
    "can_serial": combined(CanMaster, SerialMaster),
    "crtk": CrtkMaster,
    "crtk_serial": combined(CrtkMaster, SerialMaster),
}
SLAVES: dict[str, type[Device]] = {
    "simulated": SimulatedSlave,
    "virtual": VirtualSlave,
    "replay": ReplaySlave,
    "can": CanSlave,
    "serial": SerialSlave,
    "can_serial": combined(CanSlave, SerialSlave),
    "crtk": CrtkSlave,
    "crtk_serial": combined(CrtkSlave, SerialSlave),
}

__all__ = ["MASTERS", "SLAVES", "Device", "DeviceError", "Sample"]
