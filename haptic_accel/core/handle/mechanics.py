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

"""Linear time-invariant mechanics of the handle between hand, actuator and accelerometer."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray, HandleParameters, MountParameters

# Order of states and inputs of the linear mechanics.
Y_A, V_A, Y_H, V_H, X_U, Y_U, VX_U, V_U, MEASURED, X_H, VX_H, Y_M, V_M = range(13)
F_A, F_Z, F_X, AX_U, A_U, F_BETWEEN, G = range(7)
STATES, INPUTS = 13, 7
# Adjacent, to be read together: an array access costs as much as its arithmetic.
ACTUATOR_AND_HANDLE = slice(Y_A, X_U)


def mechanics(
    handle: HandleParameters, mount: MountParameters, corner: float
) -> tuple[FloatArray, FloatArray]:
    """Return A and B of x' = A x + B u: eq. (1) and (2) of the paper, and a transverse mass.

    States are positions, m, and velocities, m/s: of actuator, handle and mount along the
    actuator's axis, of the handle across it, and of the hand in both directions. The last state is
    the sensor's acceleration, m/s^2. Inputs are forces, N, and accelerations, m/s^2. Constants
    name states and inputs.

    Parameters
    ----------
    handle : HandleParameters
    mount : MountParameters
        Mount of the accelerometer.
    corner : float
        Corner of the accelerometer's first-order low-pass, Hz.
    """
    h = handle
    a, b = np.zeros((STATES, STATES)), np.zeros((STATES, INPUTS))
    for position, velocity in ((Y_A, V_A), (Y_H, V_H), (Y_U, V_U), (X_H, VX_H), (X_U, VX_U)):
        a[position, velocity] = 1.0
    bearing = np.zeros(STATES)  # force of spring and bearing on the handle
    bearing[[Y_A, Y_H, V_A, V_H]] = h.k_s, -h.k_s, h.b_s, -h.b_s
    grip = np.zeros(STATES)  # force of the hand on the handle
    grip[[Y_U, Y_H, V_U, V_H]] = h.k_u, -h.k_u, h.b_u, -h.b_u
    grip_x = np.zeros(STATES)
    grip_x[[X_U, X_H, VX_U, VX_H]] = h.k_u, -h.k_u, h.b_u, -h.b_u
    a[V_A] = -bearing / h.m_a
    b[V_A, [F_A, F_BETWEEN, G]] = -1 / h.m_a, 1 / h.m_a, 1.0
    a[V_H] = (bearing + grip) / h.m_h
    b[V_H, [F_A, F_BETWEEN, F_Z, G]] = 1 / h.m_h, -1 / h.m_h, 1 / h.m_h, 1.0
    a[VX_H] = grip_x / (h.m_a + h.m_h)
    b[VX_H, F_X] = 1 / (h.m_a + h.m_h)
    b[V_U, A_U] = b[VX_U, AX_U] = 1.0
    sensed = _add_mount(mount, a, b)
    # The accelerometer's first-order low-pass, applied to its mount's acceleration.
    omega = 2 * np.pi * corner
    a[MEASURED] = omega * a[sensed]
    a[MEASURED, MEASURED] = -omega
    b[MEASURED] = omega * b[sensed]
    return a, b


def axial_mechanics(
    handle: HandleParameters, mount: MountParameters, corner: float
) -> tuple[FloatArray, FloatArray]:
    """Return A and B of the actuator's axis for a hand at rest; the last state is the output.

    Parameters as for `mechanics`. The input is the actuator's force; B has shape (n,).
    """
    a, b = mechanics(handle, mount, corner)
    states = [Y_A, V_A, Y_H, V_H, *((Y_M, V_M) if mount.frequency else ()), MEASURED]
    return a[np.ix_(states, states)], b[states, F_A]


def zero_order_hold(a: FloatArray, b: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
    """Return the factors of the state and of a held input after a time in s."""
    from scipy.linalg import expm

    states = len(b)
    exponent = np.zeros((states + 1, states + 1))
    exponent[:states, :states], exponent[:states, states] = a * time, b * time
    transition = np.asarray(expm(exponent), dtype=np.float64)
    return transition[:states, :states], transition[:states, states]


def _add_mount(mount: MountParameters, a: FloatArray, b: FloatArray) -> int:
    """Add the accelerometer's mount to A and B; return the index of its velocity."""
    if not mount.frequency:
        return V_H
    omega = 2 * np.pi * mount.frequency
    # The mount's mass is neglected, so that it exerts no force on the handle.
    a[Y_M, V_M] = 1.0
    a[V_M, [Y_H, Y_M]] = omega**2, -(omega**2)
    a[V_M, [V_H, V_M]] = 2 * mount.damping * omega, -2 * mount.damping * omega
    return V_M
