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

"""Feedforward compensation of the dry friction in the actuator's bearing."""

from __future__ import annotations

import math
from collections import deque

from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.model import Suspension

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
        Delay of the handle's motion behind the desired one when the force acts, in samples. A
        negative delay would need future samples and counts as zero.
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
        """Return the force to add to the actuator's until the next sample, N.

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
