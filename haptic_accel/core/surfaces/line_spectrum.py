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

"""Prediction polynomials and their line spectral frequencies (Itakura 1975; Soong, Juang 1984).

A polynomial A(z) = 1 + a_1 z^-1 + ... + a_p z^-p is half the sum of a symmetric and an
antisymmetric one, whose roots lie on the unit circle. The roots' angles in (0, pi) alternate if
and only if all roots of A are inside. Interpolation of the angles between two stable polynomials
thus gives a stable one.
"""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError


def to_polynomial(lsf: FloatArray) -> FloatArray:
    """Return the coefficients 1, a_1 ... a_p of polynomials, shape (..., p + 1).

    Parameters
    ----------
    lsf : ndarray, shape (..., p)
        Line spectral frequencies in increasing order, rad per sample.
    """
    order = lsf.shape[-1]
    ahead = np.zeros((*lsf.shape[:-1], order + 2))
    behind = np.zeros_like(ahead)
    symmetric, antisymmetric = _product(lsf[..., 0::2]), _product(lsf[..., 1::2])
    if order % 2:  # fixed roots of the antisymmetric one: 1 and -1
        ahead += symmetric
        ahead[..., :-2] += antisymmetric
        behind[..., 2:] = antisymmetric
    else:  # -1 of the symmetric one, 1 of the antisymmetric one
        ahead[..., :-1] = symmetric + antisymmetric
        behind[..., 1:] = antisymmetric - symmetric
    return np.asarray((ahead - behind)[..., :-1] / 2)


def _product(angles: FloatArray) -> FloatArray:
    """Return the coefficients of the product of 1 - 2 cos(angle) z + z^2 over angles."""
    factors = np.moveaxis(-2 * np.cos(angles), -1, 0)
    product = np.zeros((2 * len(factors) + 1, *factors.shape[1:]))
    product[0] = 1.0
    for done, factor in enumerate(factors):
        before = product[: 2 * done + 1].copy()
        product[1 : 2 * done + 2] += factor * before
        product[2 : 2 * done + 3] += before
    return np.moveaxis(product, 0, -1)


def from_polynomial(polynomial: FloatArray) -> FloatArray:
    """Return the line spectral frequencies of a polynomial, rad per sample, increasing.

    Parameters
    ----------
    polynomial : ndarray, shape (p + 1,)
        Coefficients 1, a_1 ... a_p.

    Raises
    ------
    ParameterError
        A root of the polynomial is not inside the unit circle.
    """
    order = len(polynomial) - 1
    ahead, behind = np.append(polynomial, 0.0), np.append(0.0, polynomial[::-1])
    symmetric, antisymmetric = ahead + behind, ahead - behind
    if order % 2:
        antisymmetric = np.polydiv(antisymmetric, [1.0, 0.0, -1.0])[0]
    else:
        symmetric = np.polydiv(symmetric, [1.0, 1.0])[0]
        antisymmetric = np.polydiv(antisymmetric, [1.0, -1.0])[0]
    found = np.empty(order)
    found[0::2], found[1::2] = _angles(symmetric), _angles(antisymmetric)
    if not is_ordered(found):
        raise ParameterError("polynomial: a root is not inside the unit circle")
    return found


def _angles(coefficients: FloatArray) -> FloatArray:
    """Return the angles of a symmetric polynomial's roots; NaN for roots off the circle."""
    half = len(coefficients) // 2
    series = 2 * coefficients[half:]
    series[0] /= 2  # in cosines of multiples of the angle
    cosines = np.polynomial.chebyshev.chebroots(series)
    on_circle = (np.abs(cosines.imag) < 1e-7) & (np.abs(cosines.real) < 1)
    return np.sort(np.arccos(np.where(on_circle, cosines.real, np.nan)))


def is_ordered(lsf: FloatArray) -> bool:
    """Return True if frequencies increase within (0, pi) along the last axis: a stable filter."""
    ends = np.zeros((*lsf.shape[:-1], 1))
    return bool(np.all(np.diff(np.concatenate([ends, lsf, ends + np.pi], axis=-1)) > 0))


def levinson(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return prediction polynomials and innovation variances for autocovariances.

    Parameters
    ----------
    covariance : ndarray, shape (..., p + 1)
        Autocovariances at lags 0 to p; the biased ones for a signal of finite length.

    Returns
    -------
    polynomial : ndarray, shape (..., p + 1)
        Polynomials of order p, with 1 first; their roots are inside the unit circle.
    variances : ndarray, shape (..., p + 1)
        Variances of the prediction errors of orders 0 to p.
    """
    polynomial = np.zeros(covariance.shape)
    polynomial[..., 0] = 1.0
    variances = np.empty(covariance.shape)
    variances[..., 0] = covariance[..., 0] * (1 + _FLOOR) + np.finfo(float).tiny
    for n in range(covariance.shape[-1] - 1):
        error = (polynomial[..., : n + 1] * covariance[..., n + 1 : 0 : -1]).sum(axis=-1)
        reflection = (-error / variances[..., n])[..., None]
        before = polynomial[..., : n + 2].copy()
        polynomial[..., : n + 2] = before + reflection * before[..., ::-1]
        variances[..., n + 1] = variances[..., n] * (1 - reflection[..., 0] ** 2)
    return polynomial, variances


_FLOOR = 1e-9
"""White noise added to a covariance, relative to its variance; it keeps a pure tone stable."""


def autocovariance(polynomial: FloatArray, lags: int) -> FloatArray:
    """Return autocovariances from lag 0 on of unit white noise divided by polynomials.

    The inverse of `levinson`.

    Parameters
    ----------
    polynomial : ndarray, shape (..., p + 1)
        1, a_1 ... a_p; all roots inside the unit circle.
    lags : int
        Maximum lag.

    Returns
    -------
    ndarray, shape (..., lags + 1)
    """
    predictors = [polynomial]
    covariance = np.zeros((*polynomial.shape[:-1], lags + 1))
    covariance[..., 0] = 1.0
    while predictors[-1].shape[-1] > 1:  # polynomials of lower orders
        last = predictors[-1]
        unpredicted = 1 - last[..., -1:] ** 2
        predictors.append(((last - last[..., -1:] * last[..., ::-1]) / unpredicted)[..., :-1])
        covariance[..., :1] /= unpredicted
    for lag in range(1, lags + 1):
        predictor = predictors[max(0, len(predictors) - 1 - lag)][..., 1:]
        past = covariance[..., :lag][..., ::-1][..., : predictor.shape[-1]]
        covariance[..., lag] = -(predictor * past).sum(axis=-1)
    return covariance


def power_gain(forward: FloatArray, feedback: FloatArray) -> FloatArray:
    """Return the mean square of unit white noise after filters, shape (...).

    Parameters
    ----------
    forward, feedback : ndarray, shapes (..., q + 1) and (..., p + 1)
        Numerators, and denominators with 1 first and all roots inside the unit circle.
    """
    order = forward.shape[-1] - 1
    covariance = autocovariance(feedback, order)
    gain = (forward**2).sum(axis=-1) * covariance[..., 0]
    for lag in range(1, order + 1):
        gain += 2 * (forward[..., lag:] * forward[..., :-lag]).sum(axis=-1) * covariance[..., lag]
    return np.asarray(gain)
