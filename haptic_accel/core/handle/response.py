# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frequency responses of the handle, the grid for inversion, and the paper's invertible model."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
import numpy.typing as npt

from haptic_accel.core import model
from haptic_accel.core.handle.mechanics import SIMPLE, axial_mechanics, zero_order_hold
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import ParameterError

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
