# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Devices `crtk`: arms of other ROS 2 nodes, without accelerometer and actuator."""

from __future__ import annotations

import re
from dataclasses import dataclass
from time import monotonic, sleep
from typing import TYPE_CHECKING

from haptic_accel import Checked, ParameterError, parameter
from haptic_accel.core import ENABLE, ENABLED, ZERO, Force
from haptic_accel.core.parameters import like, warn_once
from haptic_accel.devices import CombinedTool, Device, DeviceError, Sample, combined
from haptic_accel.devices.serial import SerialMaster, SerialSlave

if TYPE_CHECKING:
    from haptic_accel.kits.crtk.client import ArmClient

POLL_PERIOD = 2e-3
"""Period of polling for the first position, s."""


_NAMES = re.compile(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


@dataclass(frozen=True)
class CrtkParameters(Checked):
    """Names of the arm's topics, and their time-outs."""

    namespace: str = parameter("/arm", "full namespace of the arm's topics")
    force: str = parameter(
        "servo_cf",
        "topic of the arm's force below its namespace; body/servo_cf for a dVRK, which is told to"
        " take its orientation from the base frame",
    )
    timeout: float = parameter(
        0.1, "time without a position after which there is no sample", "s", 0.005, 10.0
    )
    start_timeout: float = parameter(
        5.0, "longest time to wait for the first position", "s", 0.1, 60.0
    )

    def __post_init__(self) -> None:
        """Check all fields, and that both names are valid ROS names.

        Raises
        ------
        ParameterError
            A value is not allowed; the message names it.
        """
        super().__post_init__()
        for name in ("namespace", "force"):
            if not _NAMES.fullmatch(getattr(self, name).strip("/")):
                raise ParameterError(
                    f"{name} = {getattr(self, name)!r}: must be names of letters, digits and _,"
                    " joined by /"
                )

    @property
    def arm(self) -> str:
        """Full name of the namespace."""
        return "/" + self.namespace.strip("/")


@dataclass(frozen=True)
class CrtkMasterParameters(CrtkParameters):
    """Parameters of the master's arm."""

    namespace: str = like(CrtkParameters, "namespace", "/MTMR")


@dataclass(frozen=True)
class CrtkSlaveParameters(CrtkParameters):
    """Parameters of the slave's arm."""

    namespace: str = like(CrtkParameters, "namespace", "/PSM1")


class CrtkArm(Device):
    """Arm of another node, accessed by CRTK's `measured_cp`, `measured_cv` and `servo_cf`.

    A sample is the newest position, even if the arm sends at a lower rate. The position's stamp
    determines its age. Without velocity messages, the velocity is zero.
    """

    Parameters = CrtkParameters

    def __init__(self, parameters: CrtkParameters, rate: float, seed: int) -> None:
        self._p, self._rate = parameters, rate
        self._client: ArmClient | None = None

    def open(self) -> None:
        """Enable the arm, and wait for its first position.

        Raises
        ------
        DeviceError
            ROS 2 is not installed, or the arm sends no position.
        """
        try:
            from haptic_accel.kits.crtk.client import ArmClient
        except ModuleNotFoundError as error:
            raise DeviceError(f"crtk: {error.name} is not installed") from None
        client = self._client = ArmClient(self._p.arm, self._p.force, self._rate)
        enabled = not client.has_states
        deadline = monotonic() + self._p.start_timeout
        while (self._is_silent or not enabled) and monotonic() < deadline:
            if not enabled and client.is_heard:
                client.command(ENABLE)
                enabled = True
            sleep(POLL_PERIOD)
        if self._is_silent:
            reason = self._silence(self._p.start_timeout)
            self.close()
            raise DeviceError(reason)

    def read(self, time: float) -> Sample | None:
        """Return the newest pose and velocity; None if the pose is too old."""
        if not self._client:
            return None
        position = self._client.position.newest(self._p.timeout)
        velocity = self._client.velocity.newest(self._p.timeout)
        if position is None:
            if self._client.position.refusal:
                warn_once(self._silence(self._p.timeout))
            return None
        orientation = self._client.position.orientation
        if orientation.problem:
            warn_once(f"crtk: {self._p.arm}/measured_cp: {orientation.problem}")
        return Sample(position, velocity or ZERO, ZERO, orientation.newest)

    def write(self, time: float, *, arm_force: Force = None, actuator_force: Force = None) -> None:
        """Send the arm's force; ignore the actuator's."""
        if self._client and arm_force is not None:
            self._client.push(arm_force)

    def arm(self) -> bool | None:
        """Enable the arm, if it is present; this takes a while."""
        if not self._client or self._is_silent:
            return False
        self._client.command(ENABLE)
        return None if self._client.has_states else True

    def close(self) -> None:
        """Remove the arm's force."""
        client, self._client = self._client, None
        if client:
            client.close()

    @property
    def remark(self) -> str:
        """Remark that this device cannot enable the arm; empty if it can."""
        if not self._client or self._client.has_states:
            return ""
        return f"crtk: no crtk_msgs: {self._p.arm} must be enabled by other means"

    @property
    def hang_warning(self) -> str:
        """Warning that CRTK defines no timeout of forces."""
        return (
            f"crtk: if this process hangs, only a watchdog of {self._p.arm}'s own ends its force;"
            " CRTK promises none: find out"
        )

    @property
    def problem(self) -> str:
        """Reason why there are no samples or no forces."""
        if not self._client:
            return ""
        if (senders := self._client.position.senders) > 1:
            return f"crtk: {self._p.arm}/measured_cp has {senders} publishers"
        if self._is_silent:
            return self._silence(self._p.timeout)
        state = self._client.state
        if state and not (state.state == ENABLED and state.is_homed):
            homed = "" if state.is_homed else ", not homed"
            return f"crtk: {self._p.arm} is {state.state}{homed}"
        return ""

    def counters(self) -> dict[str, int]:
        """Return the number of refused poses."""
        return {"poses refused": self._client.position.refused if self._client else 0}

    def _silence(self, seconds: float) -> str:
        """Return the message about positions missing, or refused, for a time in s."""
        reason = self._client.position.refusal if self._client else ""
        line = f"crtk: no {self._p.arm}/measured_cp for {seconds:g} s"
        return f"{line}: refused: {reason}" if reason else line

    @property
    def _is_silent(self) -> bool:
        return self._client is None or self._client.position.newest(self._p.timeout) is None


class CrtkMaster(CrtkArm):
    """Arm of the master."""

    Parameters = CrtkMasterParameters


class CrtkSlave(CrtkArm):
    """Arm of the slave."""

    Parameters = CrtkSlaveParameters


WithBoard = combined({"crtk": CrtkMaster, "serial": SerialMaster}, "crtk", "serial")
"""Arm of the master with a board in its handle."""

ToolWithBoard = combined(
    {"crtk": CrtkSlave, "serial": SerialSlave}, "crtk", "serial", CombinedTool
)
"""Arm of the slave with a board at its tool."""
