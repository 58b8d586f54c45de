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

"""Inverses for all grips, with more and less travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.inversion.design import (
    DEFAULT_GOAL,
    Goal,
    InverseBank,
    caused_motion,
    design_basis,
    extension,
)
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import FloatArray


@dataclass(frozen=True)
class InverseFamily:
    """Inverses of all grips for each of `TRAVEL_CORNERS`.

    Attributes
    ----------
    sections : ndarray, shape (2, 6)
        Extension, independent of the grip.
    basis : ndarray, shape (k, 4, n)
        Taps to multiply by m_h, b_u, k_u and 1, and to add.
    motion : ndarray, shape (k, n)
        As in `InverseBank`; assumed to be equal for all grips.
    """

    sections: FloatArray
    basis: FloatArray
    motion: FloatArray

    def taps(self, grip: FloatArray) -> FloatArray:
        """Return the taps for a grip.

        Parameters
        ----------
        grip : ndarray, shape (3,)
            m_h, b_u and k_u: kg, N s/m, N/m.

        Returns
        -------
        ndarray, shape (k, n)
        """
        return np.asarray(np.append(grip, 1.0) @ self.basis)

    def bank(self, grip: FloatArray) -> InverseBank:
        """Return the inverses for a grip."""
        return InverseBank(self.sections, self.taps(grip), self.motion)


def design_family(plant: Plant, rate: float, goal: Goal = DEFAULT_GOAL) -> InverseFamily:
    """Design the inverse for all grips of one actuator.

    Parameters, errors
        As for `design_inverse`; the plant has the middle one of the expected grips.

    Returns
    -------
    InverseFamily
    """
    basis = design_basis(plant, rate, goal)
    handle = plant.handle
    own = np.array([handle.m_h, handle.b_u, handle.k_u, 1.0]) @ basis
    sections = extension(goal.high_pass_frequency, rate)
    return InverseFamily(sections, basis, caused_motion(plant, rate, own))
