# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Linear time-invariant mechanics of the handle, and its frequency responses.

The mechanics are between hand, actuator and accelerometer. The responses are those of the complete
handle on a grid for inversion, and of the paper's invertible model.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from haptic_accel.core import model
from haptic_accel.core.model import (
    ComplexArray,
    FloatArray,
    HandleParameters,
    ModeParameters,
    MountParameters,
    handle_model,
)
from haptic_accel.core.parameters import ParameterError

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


FINEST_STEP = 0.2
"""Frequency spacing of a grid, Hz: a fifth of the lowest corner in a filter."""


@dataclass(frozen=True)
class Grid:
    """Frequencies between the lines of a discrete Fourier transform, without 0 Hz.

    Handle and high-pass have zeros at 0 Hz, which would cause a division by zero.

    Attributes
    ----------
    rate : float
        Samples per second.
    points : int
        Number of frequencies, evenly spaced up to half the rate.
    """

    rate: float
    points: int

    @property
    def frequency(self) -> FloatArray:
        """Frequencies, Hz, shape (points,)."""
        return np.asarray((np.arange(self.points) + 0.5) * self.spacing, dtype=np.float64)

    @property
    def spacing(self) -> float:
        """Distance between two frequencies, Hz."""
        return self.rate / (2 * self.points)

    def delay(self, samples: float) -> ComplexArray:
        """Return the response of a delay."""
        turns = self.frequency / self.rate * samples
        return np.asarray(np.exp(-2j * np.pi * turns))

    def spectrum(self, sequence: FloatArray) -> ComplexArray:
        """Return the Fourier transform of a real sequence that starts at time zero.

        Parameters
        ----------
        sequence : ndarray, shape (n,)
            Real sequence; n at most twice `points`.
        """
        shift = np.exp(-1j * np.pi * np.arange(len(sequence)) / (2 * self.points))
        return np.asarray(np.fft.fft(sequence * shift, 2 * self.points)[: self.points])

    def sequence(self, spectrum: ComplexArray | FloatArray) -> FloatArray:
        """Return the real sequence of a Fourier transform, shape (2 points,).

        It is antiperiodic: its second half, with opposite sign, contains the times before zero.
        """
        both = np.concatenate([spectrum, np.zeros(self.points)])
        shift = np.exp(1j * np.pi * np.arange(2 * self.points) / (2 * self.points))
        return np.asarray(2.0 * (np.fft.ifft(both) * shift).real)


def grid_for(rate: float, taps: int = 0, step: float = FINEST_STEP) -> Grid:
    """Return a grid with a step in Hz or finer, long enough for a filter with a number of taps."""
    needed = max(rate / (2 * step), 4 * taps)
    return Grid(rate, 1 << int(np.ceil(np.log2(needed))))


ACCELEROMETER_CORNER = 500.0
"""Corner of the accelerometer's first-order low-pass, Hz (paper: ADXL320J)."""

RIGID = model.MountParameters()
"""Mount without a mode."""


def sampled_response(
    handle: HandleParameters,
    frequency: npt.ArrayLike,
    rate: float,
    delay: float = 0.0,
    low_pass_frequency: float = ACCELEROMETER_CORNER,
    mount: model.MountParameters = RIGID,
    second: model.ModeParameters = SIMPLE,
) -> ComplexArray:
    """Return the response of sampled acceleration to actuator force, with delay and low-pass.

    The force is held from one sample to the next. The response is exact for sampled signals: it
    includes sin(x)/x, half a sample of delay, and all aliases. At 1 kHz with a 500 Hz first-order
    low-pass the aliases amount to 14 % at 200 Hz.

    Parameters
    ----------
    handle : HandleParameters
    frequency : array_like, shape (n,)
        Hz, above 0 and below half the rate.
    rate : float
        Samples per second.
    delay : float
        Delay in addition to the hold, s.
    low_pass_frequency : float
        Corner of the accelerometer's first-order low-pass, Hz.
    mount : MountParameters
        Mount of the accelerometer.
    second : ModeParameters
        Second mode.

    Returns
    -------
    ndarray, shape (n,)
        Complex, m/s^2 per N.
    """
    a, b = axial_mechanics(handle, mount, low_pass_frequency, second)
    return held_response(a, b[:, np.newaxis], slice(-1, None), frequency, rate, delay)[:, 0, 0]


def held_response(
    a: FloatArray,
    b: FloatArray,
    seen: slice,
    frequency: npt.ArrayLike,
    rate: float,
    delay: float = 0.0,
) -> ComplexArray:
    """Return the exact response of sampled states of x' = A x + B u to held inputs.

    Parameters
    ----------
    a : ndarray, shape (n, n)
    b : ndarray, shape (n, m)
    seen : slice
        States that are sampled.
    frequency : array_like, shape (f,)
        Hz, above 0 and below half the rate.
    rate : float
        Samples per second.
    delay : float
        Delay in addition to the hold, s.

    Returns
    -------
    ndarray, shape (f, sampled states, m)
    """
    frequency = np.asarray(frequency, dtype=np.float64)
    late = math.ceil(delay * rate)  # whole samples until the input first appears
    over, step = zero_order_hold(a, b, 1.0 / rate)
    # An input held from sample m acts from then plus the delay. Each later sample is the sum of
    # the last period's remainder and the effect of earlier periods.
    over_rest, step_rest = zero_order_hold(a, b, late / rate - delay)
    z = np.exp(2j * np.pi * frequency / rate)
    # x[n+1] = over x[n] + step u[n], by solving (z - over) x = step for all z at once.
    states, inputs = b.shape
    resolvent = z[:, None, None] * np.eye(states) - over
    state = np.linalg.solve(resolvent, np.broadcast_to(step, (len(z), states, inputs)))
    rows = np.swapaxes(state, 1, 2).reshape(-1, states) @ over_rest[seen].T
    sampled = np.swapaxes(rows.reshape(len(z), inputs, -1), 1, 2) + step_rest[seen]
    return np.asarray(sampled * z[:, None, None] ** -late)


def cross_coupling(response: ComplexArray) -> FloatArray:
    """Return the acceleration across the driven axes relative to that along them, dB.

    It is the root of the summed squares of the elements off the diagonal over that of the elements
    on it. A coil tilted by 17.5 degrees has -10 dB.

    Parameters
    ----------
    response : ndarray, shape (..., 3, 3)
        Response of a handle with three coils, or its coupling.

    Examples
    --------
    >>> turned = np.array([[0.954, 0.0, 0.3], [0.3, 0.954, 0.0], [0.0, 0.3, 0.954]])
    >>> round(float(cross_coupling(turned)), 1)
    -10.0
    """
    power = np.abs(response) ** 2
    along = np.trace(power, axis1=-2, axis2=-1)
    with np.errstate(divide="ignore"):
        return np.asarray(10 * np.log10((power.sum(axis=(-2, -1)) - along) / along))


def travel_response(handle: HandleParameters, frequency: FloatArray) -> ComplexArray:
    """Return the actuator's displacement relative to the handle over its force, m per N.

    From eq. (1) for the difference y = y_a - y_h:
    (m_a s^2 + b_s s + k_s) Y = -F_a - m_a A_h with A_h = H F_a.

    Parameters
    ----------
    handle : HandleParameters
    frequency : ndarray, shape (n,)
        Frequencies, Hz, above 0.
    """
    s = 2j * np.pi * frequency
    actuator = handle.m_a * s**2 + handle.b_s * s + handle.k_s
    return np.asarray(-(1.0 + handle.m_a * handle_model(handle).response(frequency)) / actuator)


def inverse_terms(handle: HandleParameters, frequency: FloatArray) -> ComplexArray:
    """Return the terms of 1/H, which is linear in mass, damping and stiffness of handle and grip.

    With A = m_a s^2 + b_s s + k_s and B = b_s s + k_s, the reciprocal of eq. (3) is 1/H = A (m_h
    s^2 + b_u s + k_u) / (m_a s^4) + B / s^2, as A B - B^2 = m_a s^2 B.

    Parameters
    ----------
    handle : HandleParameters
        Handle, of which only the actuator's m_a, b_s and k_s are used.
    frequency : ndarray, shape (n,)
        Frequencies, Hz, above 0.

    Returns
    -------
    ndarray, shape (4, n)
        Factors of m_h, b_u, k_u and 1; the sum of the products is 1/H in N per m/s^2.
    """
    s = 2j * np.pi * frequency
    bearing = handle.b_s * s + handle.k_s
    shared = (handle.m_a * s**2 + bearing) / (handle.m_a * s**2)
    return np.stack([shared, shared / s, shared / s**2, bearing / s**2])


LOWEST_FREQUENCY = 15.0
"""Lower frequency limit of the model, the corner of the high-pass, Hz (paper)."""

HIGHEST_FREQUENCY = 200.0
"""Upper frequency limit of the identified band, Hz (paper)."""

_LINES = 200  # spaced evenly in the logarithm of frequency, as human perception is logarithmic
_FREQUENCIES = (4.0, 60.0)  # Hz; a slower inverse would drift, paper 9 to 20 Hz (assumed)
_DAMPING = (0.15, 1.5)  # the inverse would oscillate with less; paper 0.3 to 0.5 (assumed)
_PULL = 0.01  # towards the paper's values; matters only where the response leaves freedom

_FREE = tuple(field.name for field in fields(model.ApproximateModel) if field.name != "gain")


def approximate_model(handle: HandleParameters) -> model.ApproximateModel:
    """Choose the zero and pole pairs of the paper's model for a handle.

    Fit the logarithm of the magnitude, starting from the paper's values. The gain at zero
    frequency, which the high-pass hides, remains 1.

    Parameters
    ----------
    handle : HandleParameters
        Handle to approximate.

    Returns
    -------
    ApproximateModel

    Raises
    ------
    ParameterError
        The response of the handle vanishes in the band, so it is not a mass on a spring.
    """
    from scipy.optimize import least_squares

    frequency = np.geomspace(LOWEST_FREQUENCY, HIGHEST_FREQUENCY, _LINES)
    exact = handle_model(handle).response(frequency)
    if not np.isfinite(exact).all() or (exact == 0).any():
        raise ParameterError(
            f"handle = {handle}: has no finite response from {LOWEST_FREQUENCY:g} to"
            f" {HIGHEST_FREQUENCY:g} Hz"
        )
    paper = np.log([getattr(model.ApproximateModel(), name) for name in _FREE])
    bounds = np.log([_FREQUENCIES if name.endswith("frequency") else _DAMPING for name in _FREE])

    def residuals(point: FloatArray) -> FloatArray:
        ratio = _model(point).model().response(frequency) / exact
        return np.concatenate([np.log(np.abs(ratio)), _PULL * (point - paper)])

    found = least_squares(residuals, paper, bounds=(bounds[:, 0], bounds[:, 1]), x_scale=1.0)
    return _model(found.x)


def _model(point: FloatArray) -> model.ApproximateModel:
    return model.ApproximateModel(**dict(zip(_FREE, np.exp(point).tolist(), strict=True)))
