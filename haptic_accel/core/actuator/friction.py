"""What the dry friction of the actuator's bearing takes, given back ahead of time."""

from __future__ import annotations

import math

from haptic_accel.core.actuator.travel import TravelEstimator
from haptic_accel.core.model import Suspension

SLIP_VELOCITY = 3e-3
"""Speed at which friction is taken to have 0.76 of its force, m/s: below it the slip is not known
well enough for its sign to count."""


class FrictionCompensation:
    """Adds to a force what dry friction will take of it.

    Friction acts between actuator and handle, as the actuator's force does: a force f and friction
    mu against the slip v are together as a force f + mu sign(v). The slip that is to come follows
    from eq. (1) of the paper, as the handle is going to do as desired.

    Parameters
    ----------
    suspension : Suspension
        An actuator or a handle.
    friction : float
        N.
    rate : float
        Samples per second.
    """

    def __init__(self, suspension: Suspension, friction: float, rate: float) -> None:
        self._friction = friction
        self._slip = TravelEstimator(suspension, rate)

    def force(self, actuator_force: float, desired_acceleration: float) -> float:
        """Return what to add to a force until the next sample, N.

        Parameters
        ----------
        actuator_force : float
            That would do without friction, N.
        desired_acceleration : float
            Of the handle until the next sample, m/s^2.
        """
        if not self._friction:
            return 0.0
        before = self._slip.velocity
        self._slip.sample(actuator_force, desired_acceleration)
        # Over the sample, as the force is held over it.
        slip = (before + self._slip.velocity) / 2
        return -self._friction * math.tanh(slip / SLIP_VELOCITY)

    def reset(self) -> None:
        """Take the actuator for resting in its middle."""
        self._slip.reset()
