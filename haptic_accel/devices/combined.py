# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Devices made of two: motion and force of an arm, and the accelerometer of a handle or tool."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, ClassVar

from haptic_accel.core.model import Vector
from haptic_accel.devices.interface import LATER, Device, DeviceDescription, Reading


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
        self.parts = self._arm, self._handle

    def open(self) -> None:
        """Open both, or leave both closed."""
        with ExitStack() as opened:
            for device in self.parts:
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

    def close(self) -> None:
        """Leave both without force, one also when the other fails."""
        with ExitStack() as closing:
            for device in self.parts:
                closing.callback(device.close)

    def counters(self) -> dict[str, int]:
        """Return the counts of both, with the part as prefix."""
        return {
            f"{part}_{name}": count
            for part, device in zip(("arm", "handle"), self.parts, strict=True)
            for name, count in device.counters().items()
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
    described = DeviceDescription((arm, handle), ahead=devices[handle].description.ahead)
    return type(name, (CombinedDevice,), {**parts, "description": described})
