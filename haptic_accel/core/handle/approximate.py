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

"""Invertible model as in the paper, for any handle."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from haptic_accel.core.model import ApproximateModel, FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import ParameterError

LOWEST_FREQUENCY = 15.0
"""Lower frequency limit of the model, the corner of the high-pass, Hz (paper)."""

HIGHEST_FREQUENCY = 200.0
"""Upper frequency limit of the identified band, Hz (paper)."""

_LINES = 200  # spaced evenly in the logarithm of frequency, as human perception is logarithmic
_FREQUENCIES = (4.0, 60.0)  # Hz; a slower inverse would drift, paper 9 to 20 Hz (assumed)
_DAMPING = (0.15, 1.5)  # the inverse would oscillate with less; paper 0.3 to 0.5 (assumed)
_PULL = 0.01  # towards the paper's values; matters only where the response leaves freedom

_FREE = tuple(field.name for field in fields(ApproximateModel) if field.name != "gain")


def approximate_model(
    handle: HandleParameters, band: tuple[float, float] = (LOWEST_FREQUENCY, HIGHEST_FREQUENCY)
) -> ApproximateModel:
    """Choose the zero and pole pairs of the paper's model for a handle.

    Fit the logarithm of the magnitude, starting from the paper's values. The gain at zero
    frequency, which the high-pass hides, remains 1.

    Parameters
    ----------
    handle : HandleParameters
        Handle to approximate.
    band : tuple of float
        Band of the approximation, Hz.

    Returns
    -------
    ApproximateModel

    Raises
    ------
    ParameterError
        The band is out of range, or the response of the handle vanishes in it, so that the handle
        is no mass on a spring.
    """
    from scipy.optimize import least_squares

    low, high = band
    if not 0 < low < high < np.inf:
        raise ParameterError(f"band = {low:g} to {high:g} Hz: must satisfy 0 < low < high")
    frequency = np.geomspace(low, high, _LINES)
    exact = handle_model(handle).response(frequency)
    if not np.isfinite(exact).all() or (exact == 0).any():
        raise ParameterError(
            f"handle = {handle}: has no finite response from {low:g} to {high:g} Hz"
        )
    paper = np.log([getattr(ApproximateModel(), name) for name in _FREE])
    bounds = np.log([_FREQUENCIES if name.endswith("frequency") else _DAMPING for name in _FREE])

    def residuals(point: FloatArray) -> FloatArray:
        ratio = _model(point).model().response(frequency) / exact
        return np.concatenate([np.log(np.abs(ratio)), _PULL * (point - paper)])

    found = least_squares(residuals, paper, bounds=(bounds[:, 0], bounds[:, 1]), x_scale=1.0)
    return _model(found.x)


def _model(point: FloatArray) -> ApproximateModel:
    return ApproximateModel(**dict(zip(_FREE, np.exp(point).tolist(), strict=True)))
