# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Linear time-invariant mechanics of the handle between hand, actuator and accelerometer."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray, HandleParameters, ModeParameters, MountParameters

# Order of states and inputs of the linear mechanics.
Y_A, V_A, Y_H, V_H, X_U, Y_U, VX_U, V_U, MEASURED, X_H, VX_H, Y_M, V_M = range(13)
F_A, F_Z, F_X, AX_U, A_U, F_BETWEEN, G = range(7)
STATES, INPUTS = 13, 7
# Adjacent, to be read together: an array access costs as much as its arithmetic.
ACTUATOR_AND_HANDLE = slice(Y_A, X_U)

Y_S, V_S = STATES, STATES + 1
"""Additional states of a second mode, if there is one."""

SIMPLE = ModeParameters()
"""No second mode."""


def mechanics(
    handle: HandleParameters,
    mount: MountParameters,
    corner: float,
    second: ModeParameters = SIMPLE,
) -> tuple[FloatArray, FloatArray]:
    """Return A and B of x' = A x + B u: eq. (1) and (2) of the paper, and a transverse mass.

    States are positions, m, and velocities, m/s: of actuator, handle and mount along the
    actuator's axis, of the handle across it, and of the hand in both directions. The last state is
    the sensor's acceleration, m/s^2. Inputs are forces, N, and accelerations, m/s^2. The module's
    constants are the indices of states and inputs.

    Parameters
    ----------
    handle : HandleParameters
    mount : MountParameters
        Mount of the accelerometer.
    corner : float
        Corner of the accelerometer's first-order low-pass, Hz.
    second : ModeParameters
        Second mode, whose two states follow the others.
    """
    h = handle
    states = STATES + 2 * bool(second.frequency)
    a, b = np.zeros((states, states)), np.zeros((states, INPUTS))
    for position, velocity in ((Y_A, V_A), (Y_H, V_H), (Y_U, V_U), (X_H, VX_H), (X_U, VX_U)):
        a[position, velocity] = 1.0
    bearing = np.zeros(states)  # force of spring and bearing on the handle
    bearing[[Y_A, Y_H, V_A, V_H]] = h.k_s, -h.k_s, h.b_s, -h.b_s
    grip = np.zeros(states)  # force of the hand on the handle
    grip[[Y_U, Y_H, V_U, V_H]] = h.k_u, -h.k_u, h.b_u, -h.b_u
    grip_x = np.zeros(states)
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
    b[MEASURED] = omega * b[sensed]
    if second.frequency:
        base = (Y_M, V_M) if second.on_mount and mount.frequency else (Y_H, V_H)
        _add_mode(a, (Y_S, V_S), base, second.frequency, second.damping)
        for each in (a, b):
            each[MEASURED] += second.share * (omega * each[V_S] - each[MEASURED])
    a[MEASURED, MEASURED] = -omega
    return a, b


def axial_mechanics(
    handle: HandleParameters,
    mount: MountParameters,
    corner: float,
    second: ModeParameters = SIMPLE,
) -> tuple[FloatArray, FloatArray]:
    """Return A and B of the actuator's axis for a hand at rest; the last state is the output.

    Parameters as for `mechanics`. The input is the actuator's force; B has shape (n,).
    """
    a, b = mechanics(handle, mount, corner, second)
    of_mount = (Y_M, V_M) if mount.frequency else ()
    of_second = (Y_S, V_S) if second.frequency else ()
    states = [Y_A, V_A, Y_H, V_H, *of_mount, *of_second, MEASURED]
    return a[np.ix_(states, states)], b[states, F_A]


def zero_order_hold(a: FloatArray, b: FloatArray, time: float) -> tuple[FloatArray, FloatArray]:
    """Return the transition matrices of the state and of constant inputs over a time in s.

    B, and the matrix of the inputs, have the shape (n,) for one input, or (n, m).
    """
    from scipy.linalg import expm

    states = len(b)
    inputs = b.reshape(states, -1)
    exponent = np.zeros((states + inputs.shape[1],) * 2)
    exponent[:states, :states], exponent[:states, states:] = a * time, inputs * time
    transition = np.asarray(expm(exponent), dtype=np.float64)
    return transition[:states, :states], transition[:states, states:].reshape(b.shape)


def _add_mount(mount: MountParameters, a: FloatArray, b: FloatArray) -> int:
    """Add the accelerometer's mount to A and B; return the index of its velocity."""
    if not mount.frequency:
        return V_H
    _add_mode(a, (Y_M, V_M), (Y_H, V_H), mount.frequency, mount.damping)
    return V_M


def _add_mode(
    a: FloatArray, own: tuple[int, int], base: tuple[int, int], frequency: float, damping: float
) -> None:
    """Add a mass on a spring and a damper to A; states are indices of position and velocity."""
    omega = 2 * np.pi * frequency
    (y, v), (y_base, v_base) = own, base
    # The mode's mass is neglected, so that it exerts no force on its base.
    a[y, v] = 1.0
    a[v, [y_base, y]] = omega**2, -(omega**2)
    a[v, [v_base, v]] = 2 * damping * omega, -2 * damping * omega
