# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Voice coil actuator, and the safety layer between commands and devices: their parameters.

The limits themselves are in `core.tick.limits`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from haptic_accel.core.model import Suspension, actuator_parameter
from haptic_accel.core.parameters import Checked, ParameterError, parameter


@dataclass(frozen=True)
class ActuatorParameters(Suspension):
    """Voice coil with suspension: H2W NCM02-05-005-4JB on the spring of Table I.

    Each node that needs the actuator has these parameters in its block ``actuator``: safety layer,
    compensator, simulated device, identifier and drivers.

    Raises
    ------
    ParameterError
        A value is out of range, or the force constant is zero.
    """

    travel: float = actuator_parameter(
        3.8e-3, "free travel either way (data sheet)", "m", 0, 0.1, above=True
    )
    peak_force: float = actuator_parameter(
        6.6, "peak force of the coil (data sheet)", "N", 0, 100.0
    )
    continuous_force: float = actuator_parameter(
        2.2, "RMS force that the coil withstands continuously (data sheet)", "N", 0, 100.0
    )
    thermal_time: float = actuator_parameter(
        10.0, "thermal time constant of the coil (assumed; small ones: 5 to 30 s)", "s", 0.01, 1e4
    )
    force_constant: float = actuator_parameter(
        2.4, "force per current; negative if the wires are swapped (data sheet)", "N/A", -1e3, 1e3
    )

    def __post_init__(self) -> None:
        """Check all fields; reject a force constant of zero."""
        super().__post_init__()
        if self.force_constant == 0:
            raise ParameterError("force_constant = 0: must not be 0 N/A")


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
