"""Feedforward compensation of the dry friction in the actuator's bearing."""

from __future__ import annotations

import math

from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.model import Suspension

SLIP_VELOCITY = 3e-3
"""Slip velocity at which 0.76 of the friction is compensated, m/s: below it the predicted slip is
too uncertain for its sign to be used."""


class FrictionCompensation:
    """Computes the force that offsets dry friction, from a prediction of the slip.

    Friction acts between actuator and handle, as the actuator's force does: a force f and friction
    mu against the slip v act together as a force f + mu sign(v). The slip is predicted from
    eq. (1) of the paper, on the assumption that the handle accelerates as desired.

    Parameters
    ----------
    suspension : Suspension
        Actuator or handle.
    friction : float
        Dry friction, N.
    rate : float
        Samples per second.
    """

    def __init__(self, suspension: Suspension, friction: float, rate: float) -> None:
        self._friction = friction
        self._slip = TravelEstimator(suspension, rate)

    def force(self, actuator_force: float, desired_acceleration: float) -> float:
        """Return the force to add to the actuator's until the next sample, N.

        Parameters
        ----------
        actuator_force : float
            Actuator force that would be right without friction, N.
        desired_acceleration : float
            Desired handle acceleration until the next sample, m/s^2.
        """
        if not self._friction:
            return 0.0
        before = self._slip.velocity
        self._slip.sample(actuator_force, desired_acceleration)
        # The mean over the sample, as the force is held over it.
        slip = (before + self._slip.velocity) / 2
        return -self._friction * math.tanh(slip / SLIP_VELOCITY)

    def reset(self) -> None:
        """Return to an actuator at rest in the middle of its travel."""
        self._slip.reset()
