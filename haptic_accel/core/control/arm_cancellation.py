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
"""Cancellation of a known part of the arm's force on the handle by the coil."""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.control.filters import SampleFilter
from haptic_accel.core.model import FloatArray, Suspension


class ArmCancellation:
    """Compute the coil's force for which a known part of the arm's force moves no handle.

    In eq. (1) and (2) of the paper, the arm's force F_r on the handle and the coil's force F_a on
    handle and coil cancel if F_a = -F_r (m_a s^2 + b_s s + k_s) / (m_a s^2): the hand has no part
    in it, nor have mount and sensor, which both forces pass. Both forces act at the same time, so
    no delay has to be granted. Three poles at a corner below the felt frequencies end the two
    integrations and leave no steady force; below it the arm moves the handle as before.

    Parameters
    ----------
    suspension : Suspension
        Parameters of actuator or handle.
    corner : float
        Frequency above which the forces cancel, Hz.
    rate : float
        Samples per second.
    """

    def __init__(self, suspension: Suspension, corner: float, rate: float) -> None:
        self._filter = SampleFilter(cancelling_sections(suspension, corner, rate))

    def process(self, arm_force: float) -> float:
        """Return the coil's force, N, for a force of the arm, N, that is due with it."""
        return -self._filter.process(arm_force)

    def reset(self) -> None:
        """Return to the state for zero past force."""
        self._filter.reset()


def cancelling_sections(suspension: Suspension, corner: float, rate: float) -> FloatArray:
    """Return the sections of the filter from the arm's force to minus the coil's force.

    Parameters, as for `ArmCancellation`.

    Returns
    -------
    ndarray, shape (2, 6)
    """
    from scipy import signal

    mass = suspension.m_a
    zeros = [*np.roots([1.0, suspension.b_s / mass, suspension.k_s / mass]), 0.0]
    poles = [-2.0 * math.pi * corner] * len(zeros)
    return np.asarray(signal.zpk2sos(*signal.bilinear_zpk(zeros, poles, 1.0, rate)), dtype=float)
