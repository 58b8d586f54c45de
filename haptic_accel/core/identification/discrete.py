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

"""Discrete rational model of the handle, for effects that the physical model lacks."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.handle.plant import DiscreteModel
from haptic_accel.core.identification.estimate import RecordingError, check_pair
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.parameters import ParameterError, check_positive_rate

# scipy.signal takes half a second to import: only an identification needs it.

HIGHEST_ORDER = 40
"""Maximum number of poles."""

LONGEST_DELAY_SAMPLES = 100
"""Maximum delay in samples."""

ITERATIONS = 30
"""Maximum number of pole relocations; five to ten suffice."""

_LARGEST_RADIUS = 1.0 - 1e-6  # maximum pole radius: a pole on the unit circle does not decay
_CONVERGED = 1e-7  # maximum step of a pole
_FARTHEST_ZERO = 1e4  # a zero farther away is a zero at infinity with rounding errors


def identify_discrete(
    force: FloatArray, acceleration: FloatArray, order: int, rate: float, delay_samples: int = 1
) -> DiscreteModel:
    """Identify a discrete model from a recording that starts at rest.

    Steiglitz-McBride iterations (IEEE Trans. Automatic Control 10, 1965), which are unbiased for
    white noise in the acceleration. They use partial fractions instead of powers of z (vector
    fitting in the time domain: Gustavsen and Semlyen, IEEE Trans. Power Delivery 14, 1999), which
    are well-conditioned even at high orders and rates. Poles outside the unit circle are
    reflected.

    Parameters
    ----------
    force, acceleration : ndarray, shape (n,)
        N and m/s^2. The mean of the acceleration is removed: it is the sensor's offset, as a
        constant force causes no acceleration.
    order : int
        Number of poles, and of zeros.
    rate : float
        Samples per second.
    delay_samples : int
        Number of whole samples from a force to the first acceleration that shows it. It is 1 in a
        loop that applies its force after the measurement.

    Returns
    -------
    DiscreteModel
        Stable model. Its delay exceeds `delay_samples` if it has fewer zeros than poles.

    Raises
    ------
    ParameterError
        Order, rate or delay is out of range.
    RecordingError
        Signals differ in length, are too short, not finite, or constant.
    """
    _check(order, rate, delay_samples, force, acceleration)
    force = np.concatenate([np.zeros(delay_samples), force])[: len(force)]
    acceleration = np.asarray(acceleration, dtype=np.float64) - float(np.mean(acceleration))
    poles = _starting_poles(order, rate)
    for _ in range(ITERATIONS):
        moved = _stable(_relocated(poles, force, acceleration))
        step = np.abs(moved - poles).max()
        poles = moved
        if step < _CONVERGED:
            break
    columns = np.column_stack([_fractions(poles, force), force])
    terms = np.asarray(np.linalg.lstsq(columns, acceleration)[0], dtype=np.float64)
    sections, missing = _sections(poles, terms[:-1], float(terms[-1]))
    return DiscreteModel(sections, rate, delay_samples + missing)


def _starting_poles(order: int, rate: float) -> ComplexArray:
    """Return damped pole pairs, spaced logarithmically over the band, conjugates adjacent."""
    frequencies = np.geomspace(1e-3 * rate, 0.4 * rate, max(1, order // 2))
    upper = np.exp(2 * np.pi * frequencies / rate * (1j - 0.2))
    pairs = np.column_stack([upper, upper.conj()]).ravel()[: 2 * (order // 2)]
    return np.concatenate([pairs, [0.5 + 0j] * (order % 2)])


def _fractions(poles: ComplexArray, values: FloatArray) -> FloatArray:
    """Filter a signal by 1/(z - p) for each pole; pairs give real and imaginary parts.

    Returns
    -------
    ndarray, shape (n, order)
    """
    from scipy import signal

    columns = np.empty((len(values), len(poles)))
    for index, pole in _first_poles(poles):
        passed = signal.lfilter([0.0, 1.0], [1.0, -pole], values)
        if pole.imag:
            columns[:, index], columns[:, index + 1] = 2 * passed.real, -2 * passed.imag
        else:
            columns[:, index] = passed.real
    return columns


def _first_poles(poles: ComplexArray) -> list[tuple[int, complex]]:
    """Return the real poles and, of each conjugate pair, the pole with positive angle."""
    return [(index, pole) for index, pole in enumerate(poles.tolist()) if pole.imag >= 0.0]


def _relocated(poles: ComplexArray, force: FloatArray, acceleration: FloatArray) -> ComplexArray:
    """Return improved poles: the zeros of the weight for which both signals fit linearly."""
    from scipy.linalg import qr

    order = len(poles)
    both = np.column_stack([_fractions(poles, force), force, -_fractions(poles, acceleration)])
    scale = np.linalg.norm(both, axis=0)
    scale[scale == 0.0] = 1.0
    # The triangular factor of a QR factorisation gives the same solution with fewer rows.
    triangle = np.asarray(qr(np.column_stack([both / scale, acceleration]), mode="r")[0])
    columns = 2 * order + 1
    solution = np.linalg.lstsq(triangle[:columns, :columns], triangle[:columns, columns])[0]
    residues = (solution / scale)[order + 1 :]
    a, b = _realised(poles)
    moved = np.linalg.eigvals(a - np.outer(b, residues))
    return _ordered(np.asarray(moved, dtype=np.complex128))


def _realised(poles: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return real A and B whose states are the columns of `_fractions`."""
    order = len(poles)
    a, b = np.zeros((order, order)), np.zeros(order)
    for index, pole in _first_poles(poles):
        if pole.imag:
            pair = slice(index, index + 2)
            a[pair, pair] = [[pole.real, pole.imag], [-pole.imag, pole.real]]
            b[index] = 2.0
        else:
            a[index, index], b[index] = pole.real, 1.0
    return a, b


def _ordered(roots: ComplexArray) -> ComplexArray:
    """Return roots of a real polynomial as exact conjugate pairs, then the real ones."""
    upper = roots[roots.imag > 0]
    upper = upper[np.argsort(np.angle(upper))]
    real = np.sort(roots[roots.imag == 0].real)
    pairs = np.column_stack([upper, upper.conj()]).ravel()
    return np.concatenate([pairs, real.astype(np.complex128)])


def _stable(poles: ComplexArray) -> ComplexArray:
    """Reflect poles outside the unit circle into it."""
    radius = np.abs(poles)
    outside = radius > 1.0
    inside = np.where(outside, 1.0 / np.where(outside, radius, 1.0), radius)
    inside = np.minimum(inside, _LARGEST_RADIUS)
    factor = np.divide(inside, radius, out=np.ones_like(radius), where=radius > 0)
    return np.asarray(poles * factor)


def _sections(poles: ComplexArray, residues: FloatArray, direct: float) -> tuple[FloatArray, int]:
    """Return the sum of partial fractions as second-order sections, and samples of delay.

    Each zero at infinity becomes a sample of delay, as sections have equally many zeros and poles.
    """
    from scipy import linalg, signal

    a, b = _realised(poles)
    order = len(poles)
    # Zeros are the finite eigenvalues of the system's pencil, even without a direct term.
    pencil = np.block([[a, b[:, None]], [residues[None, :], np.array([[direct]])]])
    turned = np.diag(np.append(np.ones(order), 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.asarray(linalg.eigvals(pencil, turned), dtype=np.complex128)
    zeros = _paired(found[np.isfinite(found) & (np.abs(found) < _FARTHEST_ZERO)])
    # The gain follows from comparing both forms at a point away from poles and zeros.
    at = 2.0 + np.max(np.abs(zeros), initial=1.0)
    value = residues @ np.linalg.solve(at * np.eye(order) - a, b) + direct
    gain = float(np.real(value * np.prod(at - poles) / np.prod(at - zeros)))
    # Missing zeros are replaced by zeros at the origin, each an advance by a sample.
    sections: FloatArray = signal.zpk2sos(zeros, poles, gain)  # type: ignore[arg-type]
    return sections, order - len(zeros)


def _paired(roots: ComplexArray) -> ComplexArray:
    """Return exact conjugate pairs and real roots for roots with rounding errors."""
    real = np.abs(roots.imag) <= 1e-9 * np.maximum(np.abs(roots), 1e-9)
    upper = roots[~real & (roots.imag > 0)]
    return np.concatenate([upper, upper.conj(), roots[real].real.astype(np.complex128)])


def _check(
    order: int, rate: float, delay_samples: int, force: FloatArray, acceleration: FloatArray
) -> None:
    if not 1 <= order <= HIGHEST_ORDER:
        raise ParameterError(f"order = {order}: must be from 1 to {HIGHEST_ORDER}")
    check_positive_rate(rate)
    if not 0 <= delay_samples <= LONGEST_DELAY_SAMPLES:
        raise ParameterError(
            f"delay_samples = {delay_samples}: must be from 0 to {LONGEST_DELAY_SAMPLES}"
        )
    check_pair(force, acceleration)
    fewest = 10 * (2 * order + 1) + delay_samples
    if len(force) < fewest:
        raise RecordingError(
            f"recording: {len(force)} samples, must be at least {fewest} for order {order}"
        )
    for name, values in (("actuator_force", force), ("handle_acceleration", acceleration)):
        if np.ptp(values) == 0.0:
            raise RecordingError(f"{name}: is constant, which identifies nothing")
