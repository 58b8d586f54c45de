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
"""Coupling of a handle with three coils as causal impulse responses, fitted over frequency."""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.identification.matrix_response import COILS, MatrixResponse
from haptic_accel.core.model import ComplexArray, FloatArray

LENGTHS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Lengths among which that of the impulse responses is chosen, samples. A handle that turns in the
hand at 10 Hz needs 256 at 1 kHz."""

LARGEST_TAP = 1.0
"""Standard deviation that the prior allows the second sample of an impulse response; the direction
of a coil, the first sample, is at most 1 (assumed)."""

LAST_TAP = 0.01
"""Ratio of the last sample to `LARGEST_TAP` in the prior (assumed)."""


LEAST_DEVIATION = 1e-3
"""Least standard deviation of a line, relative to the coil's own response: a coil's plant is not
known better (assumed)."""

OUTSIDE = 0.3
"""Standard deviation of the coupling above the excited band, from that at its end (assumed): the
band says nothing about it, but a controller drives the coils there too."""

STEP_OUTSIDE = 5.0
"""Distance of the frequencies above the band, Hz."""


def fit_coupling(found: MatrixResponse, own: ComplexArray) -> FloatArray:
    """Fit the impulse responses of K in G = K diag(own), of all nine elements.

    Least squares with each line weighted by its standard deviation, regularised by a prior of
    decaying, correlated samples (TC kernel: Chen, Ohlsson and Ljung, Automatica 48(8), 2012). The
    length is that of `LENGTHS` with the smallest information criterion of Akaike (IEEE Trans.
    Automatic Control 19(6), 1974) with the effective number of parameters, so that a coupling
    which noise cannot tell from a static one is static. Above the band, the coupling is that at
    its end, with a deviation of `OUTSIDE`.

    Parameters
    ----------
    found : MatrixResponse
    own : ndarray, shape (n, 3)
        Response that each coil would have along its own axis, at the lines of `found`.

    Returns
    -------
    ndarray, shape (3, 3, length)
        Impulse responses at the rate of `found`.
    """
    fits = [_fitted(found, own, length) for length in LENGTHS]
    return min(fits, key=lambda fit: fit[1])[0]


def _fitted(found: MatrixResponse, own: ComplexArray, length: int) -> tuple[FloatArray, float]:
    """Return impulse responses of a length, and their information criterion."""
    turns = np.outer(found.frequency, np.arange(length)) / found.rate
    basis = np.exp(-2j * np.pi * turns)
    precision = _prior(length)
    above = np.arange(found.frequency[-1] + STEP_OUTSIDE, found.rate / 2, STEP_OUTSIDE)
    outside = _stacked(np.exp(-2j * np.pi * np.outer(above, np.arange(length)) / found.rate))
    outside = outside / OUTSIDE
    taps = np.zeros((COILS, COILS, length))
    error = parameters = 0.0
    for axis, coil in np.ndindex(COILS, COILS):
        least = LEAST_DEVIATION * np.abs(own[:, coil])
        deviation = np.maximum(found.deviation[:, axis, coil], least)
        rows = _stacked(basis * (own[:, coil] / deviation)[:, np.newaxis])
        measured = _stacked(found.response[:, axis, coil] / deviation)
        normal = rows.T @ rows
        end = found.response[-1, axis, coil] / own[-1, coil]
        assumed = precision + outside.T @ outside
        known = outside.T @ np.repeat([end.real / OUTSIDE, 0.0], len(outside) // 2)
        solution = np.linalg.solve(normal + assumed, rows.T @ measured + known)
        taps[axis, coil] = solution
        error += float(np.sum((measured - rows @ solution) ** 2))
        parameters += float(np.trace(np.linalg.solve(normal + assumed, normal)))
    values = 2 * COILS**2 * len(found.frequency)
    criterion = values * math.log(error / values) + 2.0 * parameters
    return taps, criterion


def _prior(length: int) -> FloatArray:
    """Return the inverse covariance of the samples; the first is free."""
    precision = np.zeros((length, length))
    if length > 1:
        index = np.arange(length - 1)
        decay = LAST_TAP ** (2.0 / (length - 1))
        covariance = LARGEST_TAP**2 * decay ** np.maximum.outer(index, index)
        precision[1:, 1:] = np.linalg.inv(covariance)
    return precision


def _stacked(values: ComplexArray) -> FloatArray:
    """Return real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])
