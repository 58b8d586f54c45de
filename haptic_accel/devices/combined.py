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

"""Devices combined from an arm (motion, force) and a handle or tool (accelerometer)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from typing import Any, ClassVar

from haptic_accel.core.model import Vector
from haptic_accel.core.orientation import is_turned, to_base
from haptic_accel.devices.interface import LATER, Device, DeviceDescription, Reading, Sample


class CombinedDevice(Device):
    """Arm that measures position and velocity, with a handle or tool for acceleration.

    A subclass names both classes. `open` opens both or neither; `close` closes both even on
    errors.

    Parameters
    ----------
    arm, handle
        Parameters of both.
    rate : float
    seed : int
    """

    ArmDevice: ClassVar[type[Device]]
    HandleDevice: ClassVar[type[Device]]

    def __init__(self, arm: Any, handle: Any, rate: float, seed: int) -> None:
        self._arm = self.ArmDevice(arm, rate, seed)
        self._handle = self.HandleDevice(handle, rate, seed)
        self.parts = self._arm, self._handle
        self.axes = self._handle.axes

    def open(self) -> None:
        """Open both, or leave both closed."""
        with ExitStack() as opened:
            for device in self.parts:
                opened.callback(device.close)
                device.open()
            opened.pop_all()

    def read(self, time: float) -> Reading:
        """Return the arm's motion and the handle's acceleration; None if either is missing."""
        motion = self._arm.read(time)
        if motion is LATER:
            return LATER
        # Read after the arm, as a handle gives each sample once.
        vibration = self._handle.read(time)
        if vibration is LATER:
            return LATER
        if motion is None or vibration is None:
            return None
        return motion._replace(acceleration=vibration.acceleration)

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        """Write each force to its device, the actuator's first."""
        if actuator_force is not None:
            self._handle.write(time, actuator_force=actuator_force)
        if arm_force is not None:
            self._arm.write(time, arm_force=arm_force)

    def close(self) -> None:
        """Leave both without force, even if either fails."""
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


class CombinedTool(CombinedDevice):
    """Arm with a tool, whose acceleration is turned to the axes of the arm's base."""

    def read(self, time: float) -> Reading:
        """Return the arm's motion and the tool's acceleration in the axes of the arm's base."""
        sample = super().read(time)
        if isinstance(sample, Sample) and is_turned(sample.orientation, sample.acceleration):
            return sample._replace(acceleration=to_base(sample.orientation, sample.acceleration))
        return sample


def combined(
    devices: Mapping[str, type[Device]],
    arm: str,
    handle: str,
    kind: type[CombinedDevice] = CombinedDevice,
) -> type[CombinedDevice]:
    """Return a device class with one device's arm, and another's handle or tool.

    The class has both devices' parameters.

    Parameters
    ----------
    devices : mapping
        Device classes by name.
    arm, handle : str
        Device names.
    kind : type
        `CombinedTool` for a slave.
    """
    parts = {"ArmDevice": devices[arm], "HandleDevice": devices[handle]}
    name = "".join(part.__name__ for part in parts.values())
    described = DeviceDescription((arm, handle), ahead=devices[handle].description.ahead)
    return type(name, (kind,), {**parts, "description": described})
