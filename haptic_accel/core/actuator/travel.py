"""How far the actuator is from its middle, from its force and the handle's acceleration."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import Suspension
from haptic_accel.core.parameters import ParameterError

LARGEST_ACCELERATION = 1.0e4
"""Above anything an accelerometer of a hand tool gives, m/s^2: a thousand g."""


class TravelEstimator:
    """The actuator's place between its stops, from what is measured anyway.

    Eq. (1) of the paper for the relative motion d = y_a - y_h,
    m_a d'' + b_s d' + k_s d = -f_a - m_a a_h,
    in which nothing of the hand is left. Advanced exactly for inputs held over each sample. As an
    accelerometer feels gravity as well, so does the estimate: the static sag is in it.

    Parameters
    ----------
    suspension : Suspension
        An actuator or a handle
    rate : float
        Samples per second.

    Raises
    ------
    ParameterError
        The rate is not a positive number.
    """

    def __init__(self, suspension: Suspension, rate: float) -> None:
        # scipy.linalg takes a while to import: only who estimates waits for it.
        from scipy.linalg import expm

        if not (np.isfinite(rate) and rate > 0):
            raise ParameterError(f"rate = {rate}: must be above 0 Hz")
        m_a, k_s, b_s = suspension.m_a, suspension.k_s, suspension.b_s
        generator = np.array([[0, 1, 0], [-k_s / m_a, -b_s / m_a, 1], [0, 0, 0]]) / rate
        transition = expm(generator)
        self._m_a = m_a
        self._position: list[float] = transition[0].tolist()
        self._velocity: list[float] = transition[1].tolist()
        self._d = self._v = 0.0

    @property
    def travel(self) -> float:
        """Where the actuator is now, m; positive away from the handle along its axis."""
        return self._d

    @property
    def velocity(self) -> float:
        """How fast it moves from the handle now, m/s."""
        return self._v

    def sample(self, actuator_force: float, handle_acceleration: float) -> float:
        """Take what acts until the next sample; return where the actuator is then.

        Parameters
        ----------
        actuator_force : float
            N.
        handle_acceleration : float
            As the accelerometer gives it, m/s^2.

        Returns
        -------
        float
            m.
        """
        push = -actuator_force / self._m_a - handle_acceleration
        d, v = self._d, self._v
        self._d = self._position[0] * d + self._position[1] * v + self._position[2] * push
        self._v = self._velocity[0] * d + self._velocity[1] * v + self._velocity[2] * push
        return self._d

    def reset(self) -> None:
        """Return to the middle, at rest."""
        self._d = self._v = 0.0
