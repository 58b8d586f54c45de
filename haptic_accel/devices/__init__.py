"""The devices by name. A new one is a class in a file of its own and a line here."""

from __future__ import annotations

from haptic_accel.devices.interface import Device, DeviceError, Sample
from haptic_accel.devices.simulated import SimulatedMaster, SimulatedSlave

MASTERS: dict[str, type[Device]] = {"simulated": SimulatedMaster}
SLAVES: dict[str, type[Device]] = {"simulated": SimulatedSlave}

__all__ = ["MASTERS", "SLAVES", "Device", "DeviceError", "Sample"]
