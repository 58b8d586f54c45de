# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices made of two: motion and force of an arm, and the accelerometer of a handle or tool."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, ClassVar

from haptic_accel.core.model import Vector
from haptic_accel.devices.interface import LATER, Device, Joints, Reading, Sample


class CombinedDevice(Device):
    """Arm that measures position and velocity, and handle or tool that measures acceleration.

    A subclass names both classes. Both are opened or none; both are closed even if one fails.

    Parameters
    ----------
    arm, handle
        Parameters of each.
    rate : float
    seed : int
    """

    ArmDevice: ClassVar[type[Device]]
    HandleDevice: ClassVar[type[Device]]

    def __init__(self, arm: Any, handle: Any, rate: float, seed: int) -> None:
        self._arm = self.ArmDevice(arm, rate, seed)
        self._handle = self.HandleDevice(handle, rate, seed)
        self._parts = {"arm": self._arm, "handle": self._handle}

    def open(self) -> None:
        """Open both, or leave both closed."""
        with ExitStack() as opened:
            for device in self._parts.values():
                opened.callback(device.close)
                device.open()
            opened.pop_all()

    def read(self, time: float) -> Reading:
        """Return the arm's motion and the handle's acceleration; nothing if either has none."""
        motion = self._arm.read(time)
        if motion is LATER:
            return LATER
        # After the arm: a handle gives each of its samples once.
        vibration = self._handle.read(time)
        if vibration is LATER:
            return LATER
        if motion is None or vibration is None:
            return None
        return motion._replace(acceleration=vibration.acceleration)

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: float | None = None
    ) -> None:
        """Write each force to its device, the actuator's first."""
        if actuator_force is not None:
            self._handle.write(time, actuator_force=actuator_force)
        if arm_force is not None:
            self._arm.write(time, arm_force=arm_force)

    def arm(self) -> bool | None:
        """Arm both; return False if one cannot, None if one takes a while."""
        answers = self._arm.arm(), self._handle.arm()
        if False in answers:
            return False
        return None if None in answers else True

    def joints(self, sample: Sample, force: Vector) -> Joints:
        """Return the arm's joints."""
        return self._arm.joints(sample, force)

    def close(self) -> None:
        """Leave both without force, one also when the other fails."""
        with ExitStack() as closing:
            for device in self._parts.values():
                closing.callback(device.close)

    @property
    def remark(self) -> str:
        """Remarks of both."""
        return "; ".join(device.remark for device in self._parts.values() if device.remark)

    @property
    def unguarded(self) -> str:
        """Warnings of both."""
        return "; ".join(each.unguarded for each in self._parts.values() if each.unguarded)

    @property
    def problem(self) -> str:
        """Problems of both."""
        return "; ".join(device.problem for device in self._parts.values() if device.problem)

    @property
    def late(self) -> int:
        """Number of forces that either part applied late."""
        return self._arm.late + self._handle.late

    def status(self) -> dict[str, int]:
        """Return the counts of both, with the part as prefix."""
        return {
            f"{part}_{name}": count
            for part, device in self._parts.items()
            for name, count in device.status().items()
        }


def combined(devices: Mapping[str, type[Device]], arm: str, handle: str) -> type[CombinedDevice]:
    """Return the class of a device with the arm of one device, and the handle or tool of another.

    It has the parameters of both.

    Parameters
    ----------
    devices : mapping
        Device classes by name.
    arm, handle : str
        Names of the two.
    """
    parts = {"ArmDevice": devices[arm], "HandleDevice": devices[handle]}
    name = "".join(part.__name__ for part in parts.values())
    own = {"PARAMETERS_OF": (arm, handle), "AHEAD": devices[handle].AHEAD}
    return type(name, (CombinedDevice,), {**parts, **own})
