# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the safety layer between commands and devices, `core.tick.limits`."""

from __future__ import annotations

from dataclasses import dataclass, field

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.parameters import Checked, parameter

ACTUATOR_TIMEOUT = 5e-3
"""Default time-out of the actuator's commands, s: five periods of the paper's loop."""

ARM_TIMEOUT = 20e-3
"""Default time-out of an arm's commands, s: a hand moves millimetres in that time."""

LEAST_PERIODS = 2.5
"""Minimum time-out in periods, so that one lost command does not trip the watchdog."""

MAX_AGE = 0.1
"""Default maximum age of a command's sample, s; also the maximum clock difference."""

ARM_PEAK_FORCE = 3.3
"""Maximum force of a Phantom Omni (data sheet), N."""

AUTOMATIC, MANUAL = "automatic", "manual"

_TIMEOUT = (
    f"time without a command after which the force is zero; {LEAST_PERIODS:g} periods at least"
)


@dataclass(frozen=True)
class ActuatorCommandLimits(Checked):
    """Limits of the actuator's commands, in addition to the actuator's own limits."""

    command_timeout: float = parameter(ACTUATOR_TIMEOUT, _TIMEOUT, "s", 1e-3, 10.0)
    max_age: float = parameter(
        MAX_AGE,
        "maximum age of the sample that caused a command, and maximum lead of its stamp;"
        " above these, the force is zero",
        "s",
        1e-3,
        10.0,
    )
    slew_rate: float = parameter(
        0.0, "maximum rate of growth of the force; 0 for no limit", "N/s", 0, 1e6
    )


@dataclass(frozen=True)
class ArmLimits(ActuatorCommandLimits):
    """Limits of the commands for an arm's motors."""

    command_timeout: float = parameter(ARM_TIMEOUT, _TIMEOUT, "s", 1e-3, 10.0)
    peak_force: float = parameter(
        ARM_PEAK_FORCE, "limit of the arm's force (Phantom Omni: 3.3 N)", "N", 0, 100
    )
    zero_stamp: bool = parameter(
        True, "accept commands without a stamp, as CRTK allows; their arrival time counts"
    )


@dataclass(frozen=True)
class SafetyParameters(Checked):
    """Safety limits of a device with an arm."""

    recovery: str = parameter(
        AUTOMATIC,
        "recovery after missing or outdated commands: by the next valid command, or only by the"
        " service ~/arm",
        choices=(AUTOMATIC, MANUAL),
    )
    arm: ArmLimits = field(default_factory=ArmLimits)


@dataclass(frozen=True)
class MasterSafetyParameters(SafetyParameters):
    """Safety limits of a device with an arm and an actuator."""

    actuator: ActuatorCommandLimits = field(default_factory=ActuatorCommandLimits)
    hardware: ActuatorParameters = field(default_factory=ActuatorParameters)
