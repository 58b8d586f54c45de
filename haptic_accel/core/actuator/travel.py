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

"""Estimate of the actuator's displacement from its force and the handle's acceleration."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import Suspension
from haptic_accel.core.parameters import check_positive_rate

LARGEST_ACCELERATION = 1.0e4
"""Upper bound of plausible measurements, about a thousand g, above the range of any hand tool's
accelerometer, m/s^2."""


class TravelEstimator:
    """Estimate the actuator's position between its stops from available signals.

    Eq. (1) of the paper for the relative motion d = y_a - y_h, m_a d'' + b_s d' + k_s d = -f_a -
    m_a a_h, which does not depend on the hand. The discretisation is exact for inputs held over
    each sample. As the accelerometer also measures gravity, the estimate includes the static sag.

    Parameters
    ----------
    suspension : Suspension
        Parameters of actuator or handle.
    rate : float
        Samples per second.

    Attributes
    ----------
    travel : float
        Present displacement of the actuator, m; positive away from the handle along its axis.
    velocity : float
        Present velocity of the actuator relative to the handle, m/s.

    Raises
    ------
    ParameterError
        The rate is not a positive number.
    """

    def __init__(self, suspension: Suspension, rate: float) -> None:
        # scipy.linalg is slow to import: only users of an estimator need it.
        from scipy.linalg import expm

        check_positive_rate(rate)
        m_a, k_s, b_s = suspension.m_a, suspension.k_s, suspension.b_s
        generator = np.array([[0, 1, 0], [-k_s / m_a, -b_s / m_a, 1], [0, 0, 0]]) / rate
        transition = expm(generator)
        self._m_a = m_a
        self._transition: list[list[float]] = transition[:2].tolist()
        self.travel = self.velocity = 0.0

    def observe(self, actuator_force: float, handle_acceleration: float) -> float:
        """Advance by one sample; return the displacement at its end, m.

        Parameters
        ----------
        actuator_force : float
            Force until the next sample, N.
        handle_acceleration : float
            Measured handle acceleration, gravity included, m/s^2.

        Returns
        -------
        float
            Displacement at the next sample, m.
        """
        push = -actuator_force / self._m_a - handle_acceleration
        (d_d, d_v, d_push), (v_d, v_v, v_push) = self._transition
        d, v = self.travel, self.velocity
        self.velocity = v_d * d + v_v * v + v_push * push
        self.travel = travel = d_d * d + d_v * v + d_push * push
        return travel

    def reset(self) -> None:
        """Reset to the middle, at rest."""
        self.travel = self.velocity = 0.0
