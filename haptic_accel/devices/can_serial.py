"""Arms on a CAN bus with an accelerometer, and at the master an actuator, on a serial line."""

from __future__ import annotations

from dataclasses import dataclass, field

from haptic_accel.core.parameters import Checked
from haptic_accel.devices.can.device import CanMaster, CanSlave
from haptic_accel.devices.can.parameters import CanMasterParameters, CanSlaveParameters
from haptic_accel.devices.combined import CombinedDevice
from haptic_accel.devices.serial.device import (
    SerialMaster,
    SerialMasterParameters,
    SerialSlave,
    SerialSlaveParameters,
)


@dataclass(frozen=True)
class CanSerialMasterParameters(Checked):
    """Of the arm on the bus, and of the board in the handle."""

    arm: CanMasterParameters = field(default_factory=CanMasterParameters)
    handle: SerialMasterParameters = field(default_factory=SerialMasterParameters)


@dataclass(frozen=True)
class CanSerialSlaveParameters(Checked):
    """Of the arm on the bus, and of the board at the tool."""

    arm: CanSlaveParameters = field(default_factory=CanSlaveParameters)
    handle: SerialSlaveParameters = field(default_factory=SerialSlaveParameters)


class CanSerialMaster(CombinedDevice):
    """The master: an arm of ODrives, and a handle behind a microcontroller."""

    Parameters = CanSerialMasterParameters
    Arm, Handle = CanMaster, SerialMaster


class CanSerialSlave(CombinedDevice):
    """The slave: an arm of ODrives, and a tool behind a microcontroller."""

    Parameters = CanSerialSlaveParameters
    Arm, Handle = CanSlave, SerialSlave
