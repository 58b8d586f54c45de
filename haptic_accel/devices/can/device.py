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

"""Devices `can`: arms on a CAN bus, without accelerometer and actuator."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep
from typing import TypeVar

from haptic_accel.core.model import Vector
from haptic_accel.devices.can.arm import LONGEST_SILENCE, State
from haptic_accel.devices.can.bus import bitrate_of
from haptic_accel.devices.can.link import ArmLink
from haptic_accel.devices.can.load import BusLoad
from haptic_accel.devices.can.parameters import (
    REQUESTED,
    CanMasterParameters,
    CanParameters,
    CanSlaveParameters,
)
from haptic_accel.devices.interface import Device, DeviceError, Joints, Sample

T = TypeVar("T")

POLL_PERIOD = 2e-3
"""Period of polling while a device opens, s."""


class CanArm(Device):
    """Arm of one to three ODrives that move a tip; there is no accelerometer and no actuator.

    It has torques only while every axis reports to be in closed loop and without error. Otherwise
    all axes are released, with zero torque and idle, until `arm` is called, or, with `rearm`
    ``auto``, until all lost reports are back.
    """

    Parameters = CanParameters

    def __init__(self, parameters: CanParameters, rate: float, seed: int) -> None:
        self._p = parameters
        self._rate = rate
        self._link = ArmLink(parameters)
        self._arm = self._link.arm
        self._measured_since = monotonic()
        self._measured_bits = 0

    def open(self) -> None:
        """Open the bus, wait for every axis, see that its watchdog works, and arm.

        Raises
        ------
        DeviceError
            The bus cannot be opened, an axis does not report, does not go into closed loop, or
            stays there without commands.
        ParameterError
            The interface does not exist.
        """
        self._link.open()
        try:
            if silent := self._wait_while(lambda: self._arm.missing(monotonic())):
                raise DeviceError(
                    f"can: {self._channel}: no heartbeat of {silent} for"
                    f" {self._p.start_timeout:g} s: powered, wired, {self.load.bitrate:g} bit/s?"
                )
            self._arm.arm(monotonic(), test=True)
            pending = State.ARMING, State.FALLING_SILENT
            # Armed twice, and silent in between.
            longest = 2 * self._p.start_timeout + LONGEST_SILENCE
            self._wait_while(lambda: self._arm.state in pending, longest)
            if self._arm.state is not State.ARMED:
                raise DeviceError(f"can: {self._channel}: {self._arm.fault or 'is not armed'}")
        except DeviceError:
            self.close()
            raise

    def read(self, time: float) -> Sample | None:
        """Return the newest position and velocity of the tip, None if too old; never waits."""
        return self._arm.read(monotonic())

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: float | None = None
    ) -> None:
        """Send the torques for a force of the tip; an actuator's force is ignored."""
        if arm_force is not None:
            self._arm.apply(arm_force, monotonic())

    def joints(self, sample: Sample, force: Vector) -> Joints:
        """Return the driven joints by the drives' newest estimates, with the torques given."""
        return self._arm.joints()

    def close(self) -> None:
        """Leave every axis idle and without torque, also when it was never opened."""
        self._link.close()

    @property
    def remark(self) -> str:
        """Load of the bus, with a warning if it is too high, and what the drives do in silence."""
        longest = self._arm.longest_silence
        return f"can: {self._channel}: {self.load}, without commands no torque in {longest:.2f} s"

    @property
    def load(self) -> BusLoad:
        """Largest load of the bus by the arm."""
        return BusLoad(
            len(self._p.joints),
            self._rate,
            bitrate_of(self._link.configuration),
            self._p.estimates == REQUESTED,
        )

    def counters(self) -> dict[str, int]:
        """Return counts, and the load of the bus since the last call in percent."""
        now, link = monotonic(), self._link
        seconds = max(now - self._measured_since, POLL_PERIOD)
        load = (link.bits - self._measured_bits) / seconds / bitrate_of(link.configuration)
        self._measured_since, self._measured_bits = now, link.bits
        return {
            "connected": int(link.connected),
            **self._arm.counters(),
            "bus_load_percent": round(100 * load),
            **link.counts,
            "bus_losses": link.losses,
        }

    @property
    def problem(self) -> str:
        """Reason why there are no torques, in one line; empty while there are."""
        return "" if self._arm.state is State.ARMED else self._arm.fault

    def arm(self) -> bool | None:
        """Begin to arm, which takes a heartbeat or two: None, or False while the bus is gone.

        Torques are zero until the next force; `armed` and `problem` show the result.
        """
        if not self._link.connected:
            return False
        self._arm.arm(monotonic())
        return None

    @property
    def _channel(self) -> str:
        configuration = self._link.configuration
        names = [str(configuration.get(key) or "") for key in ("interface", "channel")]
        return " ".join(name for name in names if name)

    def _wait_while(self, pending: Callable[[], T], longest: float = 0.0) -> T:
        """Wait while something is pending, at most the time to start or another; return it."""
        deadline = monotonic() + (longest or self._p.start_timeout) + POLL_PERIOD
        while (still := pending()) and monotonic() < deadline:
            sleep(POLL_PERIOD)
        return still


class CanMaster(CanArm):
    """Arm of the master."""

    Parameters = CanMasterParameters


class CanSlave(CanArm):
    """Arm of the slave."""

    Parameters = CanSlaveParameters
