# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Parameters of the actuator, shared by drivers, limits and simulation."""

from __future__ import annotations

from dataclasses import dataclass

from haptic_accel.core.model import Suspension, actuator_parameter
from haptic_accel.core.parameters import ParameterError


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
