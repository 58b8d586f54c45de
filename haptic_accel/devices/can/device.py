"""The devices whose arms are on a CAN bus."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

from haptic_accel.core.model import Vector
from haptic_accel.devices.can.arm import Arm, State
from haptic_accel.devices.can.bus import bitrate_of, bus_configuration, open_bus
from haptic_accel.devices.can.link import Link
from haptic_accel.devices.can.load import BusLoad
from haptic_accel.devices.can.parameters import (
    REQUESTED,
    CanMasterParameters,
    CanParameters,
    CanSlaveParameters,
)
from haptic_accel.devices.interface import Device, DeviceError, Sample

POLL_PERIOD = 2e-3
"""Between looks at what is waited for while a device opens, s."""


class CanArm(Device):
    """One to three ODrives that move a tip; there is no accelerometer and no actuator.

    It has torques only while every axis is heard, in closed loop and without error. When that
    ends it lets go: zero torque and idle, until `arm` is called, or until what was lost is back
    where `rearm` is ``auto``.
    """

    Parameters = CanParameters

    def __init__(self, parameters: CanParameters, rate: float, seed: int) -> None:
        self._p = parameters
        self._rate = rate
        self._configuration: dict[str, Any] = {}
        self._link = Link(self._open_bus)
        self._arm = Arm(parameters, self._link.send)
        self._measured_since = monotonic()
        self._measured_bits = 0

    def open(self) -> None:
        """Open the bus, wait for every axis, and arm.

        Raises
        ------
        DeviceError
            The bus cannot be opened, an axis is not heard, or does not go into closed loop.
        ParameterError
            There is no such interface.
        """
        self._configuration = bus_configuration(self._p)
        self._link.start(self._arm)
        try:
            self._wait(lambda: not self._arm.missing(monotonic()))
            silent = self._arm.missing(monotonic())
            if silent:
                raise DeviceError(
                    f"can: {self._channel}: no heartbeat of {silent} for"
                    f" {self._p.start_timeout:g} s: powered, wired, {self.load.bitrate:g} bit/s?"
                )
            self.arm()
            self._wait(lambda: self._arm.state is not State.ARMING)
            if self._arm.state is not State.ARMED:
                raise DeviceError(f"can: {self._channel}: {self._arm.fault or 'is not armed'}")
        except DeviceError:
            self.close()
            raise

    def read(self, time: float) -> Sample | None:
        """Return the newest position and velocity of the tip, if there are; never waits."""
        return self._arm.read(monotonic())

    def write(
        self,
        time: float,
        *,
        arm_force: Vector | None = None,
        actuator_force: float | None = None,
    ) -> None:
        """Send the torques that make a force of the tip; an actuator's force is ignored."""
        if arm_force is not None:
            self._arm.apply(arm_force, monotonic())

    def close(self) -> None:
        """Leave every axis idle and without torque, also when it was never opened."""
        if self._link.connected:
            self._arm.disarm()
        self._link.stop()

    @property
    def remark(self) -> str:
        """What the arm takes of its bus, and whether that fits."""
        return f"can: {self._channel}: {self.load}"

    @property
    def load(self) -> BusLoad:
        """What the arm takes of its bus, at most."""
        return BusLoad(
            len(self._p.joints),
            self._rate,
            bitrate_of(self._configuration),
            self._p.estimates == REQUESTED,
        )

    def status(self) -> dict[str, int]:
        """Return counts, and the load of the bus since the last call in percent."""
        now, bits = monotonic(), self._link.bits
        seconds = max(now - self._measured_since, POLL_PERIOD)
        load = (bits - self._measured_bits) / seconds / bitrate_of(self._configuration)
        self._measured_since, self._measured_bits = now, bits
        link = self._link
        return {
            "connected": int(link.connected),
            **self._arm.status(),
            "bus_load_percent": round(100 * load),
            "frames_received": link.received,
            "frames_sent": link.sent,
            "frames_garbled": link.garbled,
            "send_failures": link.send_failures,
            "bus_losses": link.losses,
        }

    @property
    def problem(self) -> str:
        """Why there are no torques, in one line; empty while there are."""
        return "" if self._arm.state is State.ARMED else self._arm.fault

    @property
    def armed(self) -> bool:
        """Whether there are torques."""
        return self._arm.state is State.ARMED

    def arm(self) -> bool | None:
        """Begin to arm, which takes a heartbeat or two: None, or False while the bus is gone.

        Torques are zero until the next force; `armed` and `problem` tell what came of it.
        """
        self._arm.arm(monotonic())
        return None if self._link.connected else False

    def disarm(self) -> bool:
        """Leave every axis idle and without torque until `arm`; whether the bus is there."""
        self._arm.disarm()
        return self._link.connected

    @property
    def _channel(self) -> str:
        names = [str(self._configuration.get(key) or "") for key in ("interface", "channel")]
        return " ".join(name for name in names if name)

    def _open_bus(self) -> Any:
        return open_bus(self._configuration, self._arm.nodes)

    def _wait(self, condition: Callable[[], bool]) -> None:
        """Wait until a condition holds, or the time to start is over."""
        deadline = monotonic() + self._p.start_timeout + POLL_PERIOD
        while not condition() and monotonic() < deadline:
            sleep(POLL_PERIOD)


class CanMaster(CanArm):
    """The master's arm."""

    Parameters = CanMasterParameters


class CanSlave(CanArm):
    """The slave's arm."""

    Parameters = CanSlaveParameters
