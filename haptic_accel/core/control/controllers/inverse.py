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

"""Inverse of the complete identified handle, including hold, delay, mount and sensor."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

from haptic_accel.core.control.controllers.interface import Controller, Loop
from haptic_accel.core.control.filters import SampleFilter
from haptic_accel.core.control.inversion import design
from haptic_accel.core.control.inversion.excursion import ExcursionControl
from haptic_accel.core.control.inversion.spectrum import TexturePrior
from haptic_accel.core.model import Suspension
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick import TravelEstimator


@dataclass(frozen=True)
class InverseParameters(Checked):
    """Delay and texture for the design of the inverse."""

    granted_time: float = parameter(
        design.GRANTED_TIME,
        "allowed delay of the handle behind the tool in addition to the latency, rounded to"
        " samples, at least one (paper: one at 1 kHz)",
        unit="s",
        low=0.0,
        high=design.LONGEST_GRANTED_TIME,
    )
    texture: TexturePrior = field(default_factory=TexturePrior)
    memory: float = parameter(
        design.CONVOLUTION_LENGTH, "length of the controller's impulse response", "s", 0.05, 0.4
    )

    def filter(self, loop: Loop) -> design.InverseFilter:
        """Return the inverse without travel reduction for a loop; takes a fraction of a second.

        Raises
        ------
        ParameterError
            The rate is too low for the high-pass.
        """
        return design.design_inverse(loop.plant, loop.rate, self.goal(loop))

    def granted_delay(self, rate: float) -> int:
        """Return the granted delay at a rate in Hz, in samples."""
        return design.granted_samples(self.granted_time, rate)

    def goal(self, loop: Loop) -> design.Goal:
        """Return the design goal of the inverse, or of a family of inverses."""
        granted = loop.latency + self.granted_delay(loop.rate)
        corner = loop.high_pass_frequency
        return design.Goal(granted, self.memory, spectrum=self.texture, high_pass_frequency=corner)


class InverseController(Controller):
    """Causal inverse of eq. (3), hold, delay, mount and sensor, from a_hdes to f_a.

    Attributes
    ----------
    response : callable
        Force over desired acceleration, N per m/s^2, at frequencies in Hz.
    friction_force : float
        Part of the last force that compensates dry friction, N.
    """

    Parameters = InverseParameters
    reducible = True

    def __init__(self, parameters: InverseParameters, loop: Loop) -> None:
        goal = parameters.goal(loop)
        bank = design.design_bank(loop.plant, loop.rate, goal)
        self.response = design.InverseFilter(bank.sections, bank.taps[0], loop.rate, goal).response
        self._invert_by(bank, parameters, loop)

    def _invert_by(
        self, bank: design.InverseBank, parameters: InverseParameters, loop: Loop
    ) -> None:
        plant = loop.plant
        self._bank = bank
        self._extension = SampleFilter(bank.sections)
        self._excursion = ExcursionControl(bank, plant.handle, loop.travel_limit, loop.rate)
        # A force acts in the period before the sample that shows it.
        lag = parameters.granted_delay(loop.rate) - 0.5 - plant.delay * loop.rate
        self._friction = FrictionCompensation(plant.handle, plant.friction, loop.rate, lag)
        self.friction_force = 0.0

    def force(self, desired_acceleration: float, measured_acceleration: float) -> float:
        """Return the force for the desired acceleration."""
        return self._driven(self._extension.process(desired_acceleration), desired_acceleration)

    def _driven(self, extended: float, desired_acceleration: float) -> float:
        """Return the force for the desired acceleration before and after the extension."""
        force = self._excursion.process(extended)
        self.friction_force = self._friction.force(force, desired_acceleration)
        return force + self.friction_force

    def reset(self) -> None:
        """Clear the filters."""
        self._extension.reset()
        self._excursion.restart(self._bank.taps)
        self._friction.reset()
        self.friction_force = 0.0


SLIP_VELOCITY = 3e-3
"""Slip velocity at which 0.76 of the friction is compensated, m/s: below it the predicted slip is
too uncertain for its sign to be used."""


class FrictionCompensation:
    """Compute the force that compensates dry friction, from a prediction of the slip.

    Friction acts between actuator and handle, like the actuator's force. A force f and friction mu
    against the slip v together act as a force f + mu sign(v). The slip is predicted from eq. (1)
    of the paper, assuming that the handle follows the desired acceleration with a delay.

    Parameters
    ----------
    suspension : Suspension
        Parameters of actuator or handle.
    friction : float
        Dry friction, N.
    rate : float
        Samples per second.
    lag : float
        Delay of the handle behind the desired motion when the force acts, in samples. A negative
        delay would need future samples and counts as zero.
    """

    def __init__(
        self, suspension: Suspension, friction: float, rate: float, lag: float = 0.0
    ) -> None:
        self._friction = friction
        whole = int(max(0.0, lag))
        self._share = max(0.0, lag) - whole
        self._desired = deque([0.0] * (whole + 2), whole + 2)
        self._slip = TravelEstimator(suspension, rate)

    def force(self, actuator_force: float, desired_acceleration: float) -> float:
        """Return the force to add until the next sample, N.

        Parameters
        ----------
        actuator_force : float
            Required actuator force without friction, N.
        desired_acceleration : float
            Latest desired handle acceleration, m/s^2.
        """
        if not self._friction:
            return 0.0
        before = self._slip.velocity
        self._desired.append(desired_acceleration)
        earlier, later = self._desired[0], self._desired[1]
        self._slip.observe(actuator_force, later + self._share * (earlier - later))
        # Mean over the sample, as the force is held over it.
        slip = (before + self._slip.velocity) / 2
        return -self._friction * math.tanh(slip / SLIP_VELOCITY)

    def reset(self) -> None:
        """Return to an actuator at rest in the middle of its travel."""
        self._slip.reset()
        self._desired.extend([0.0] * len(self._desired))
