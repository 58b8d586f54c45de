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

"""Estimation and compensation of the delay between two signals, to a fraction of a sample.

The components of a vector, shape (n, k), have one delay in common.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.filters import comparable
from haptic_accel.core.evaluation.metrics import align, components
from haptic_accel.core.model import ComplexArray, FloatArray

LONGEST_DELAY = 20e-3
"""Maximum lag searched, either way, s: twenty times the paper's, one period of 50 Hz."""

FRACTION_EDGE = 32
"""Samples dropped at both ends after a shift by a fraction of a sample, as interpolation needs
neighbours on both sides."""

ALIKE = 0.3
"""Minimum correlation for a delay. Below it, less than a tenth of the power is common, perhaps due
to the hand, the sensor or chance."""

WHOLE = 1e-6
"""Distance from a whole number of samples below which a shift counts as whole."""


@dataclass(frozen=True)
class Delay:
    """Lag with the highest correlation of two signals.

    Attributes
    ----------
    seconds : float
        Lag, s; positive if the second signal is later; NaN without a distinct maximum.
    correlation : float
        Correlation coefficient of the signals at that lag, 0 to 1.
    """

    seconds: float
    correlation: float


def estimate_delay(
    desired: FloatArray, actual: FloatArray, rate: float, longest: float = LONGEST_DELAY
) -> Delay:
    """Find the lag of `actual` behind `desired` by the peak of their cross-correlation.

    The peak is refined between samples on the band-limited cross-correlation itself. A parabola
    would be biased by up to a twentieth of a sample. This is the generalised correlation method
    without weights (Knapp and Carter, IEEE Trans. ASSP 24(4), 1976): the lag at which a pure delay
    has the least error. For other responses, the result is the lag at the frequencies with most of
    the common power.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Signals with the same sampling times and unit; finite.
    rate : float
        Samples per second.
    longest : float
        Maximum lag searched, either way, s.

    Returns
    -------
    Delay
        NaN if a signal is constant or empty, if the correlation is below `ALIKE` at all lags up to
        the longest, or if it is largest at the longest lag.
    """
    nothing = Delay(math.nan, 0.0)
    if not len(desired):
        return nothing
    first, second = desired - np.mean(desired, axis=0), actual - np.mean(actual, axis=0)
    scale = float(np.linalg.norm(first)) * float(np.linalg.norm(second))
    farthest = min(math.ceil(longest * rate), len(first) - 2)
    if not scale > 0.0 or farthest < 1:
        return nothing
    from scipy import fft

    # Zeros after the signals prevent circular overlap.
    length = fft.next_fast_len(len(first) + farthest + 1, real=True)
    pairs = zip(components(first), components(second), strict=True)
    products = [np.conj(fft.rfft(one, length)) * fft.rfft(other, length) for one, other in pairs]
    cross: ComplexArray = np.sum(products, axis=0)
    correlation = fft.irfft(cross, length)
    lags = np.arange(-farthest, farthest + 1)
    peak = int(lags[np.argmax(correlation[lags])])
    if abs(peak) == farthest or correlation[peak] <= 0.0:
        return nothing
    lag, likeness = _between_samples(cross, length, peak)
    found = min(likeness / scale, 1.0)
    return Delay(lag / rate if found >= ALIKE else math.nan, found)


def _between_samples(cross: ComplexArray, length: int, peak: int) -> tuple[float, float]:
    """Return lag and value of a cross-correlation's maximum around its peak sample."""
    from scipy import optimize

    turns = 2j * np.pi * np.arange(cross.size) / length
    weights = np.full(cross.size, 2.0 / length)
    weights[0] = 1.0 / length
    if length % 2 == 0:
        weights[-1] = 1.0 / length

    def less(lag: float) -> float:
        return -float(np.sum(weights * (cross * np.exp(turns * lag)).real))

    found = optimize.minimize_scalar(
        less, bounds=(peak - 1, peak + 1), method="bounded", options={"xatol": 1e-4}
    )
    return float(found.x), -float(found.fun)


def shift_back(
    desired: FloatArray, actual: FloatArray, rate: float, delay: float
) -> tuple[FloatArray, FloatArray]:
    """Shift a response back by its delay, so that it coincides with its cause.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Sampled at the same times.
    rate : float
        Samples per second.
    delay : float
        Lag of `actual`, s; negative if it leads. A whole number of samples only shifts the
        signals. For a fraction, `actual` is interpolated as a band-limited signal.

    Returns
    -------
    tuple of ndarray, each of the same length
        Desired and actual signal where both exist.

    Raises
    ------
    ValueError
        The signals differ in length, or are not longer than the shift.
    """
    samples = delay * rate
    whole = round(samples) if abs(samples - round(samples)) < WHOLE else math.floor(samples)
    if whole < 0:
        later, earlier = align(actual, desired, -whole)
        desired, actual = earlier, later
    else:
        desired, actual = align(desired, actual, whole)
    fraction = samples - whole
    if abs(fraction) < WHOLE:
        return desired, actual
    if len(actual) <= 2 * FRACTION_EDGE:
        raise ValueError(f"{len(actual)} samples: too few for a fractional shift")
    inner = slice(FRACTION_EDGE, -FRACTION_EDGE)
    return desired[inner], _advanced(actual, fraction)[inner]


def aligned(
    desired: FloatArray, handle: FloatArray, high_pass_frequency: float, rate: float, delay: float
) -> tuple[FloatArray, FloatArray]:
    """Return desired and actual acceleration without the hand's own motion, aligned at a delay.

    Parameters
    ----------
    desired, handle : ndarray, shape (n,) or (n, k)
        Desired acceleration and the handle's, sampled at the same times, m/s^2.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    rate : float
        Samples per second.
    delay : float
        Lag of the handle, s.

    Raises
    ------
    ValueError
        As for `shift_back`.
    """
    # Whole samples first, so that the filter begins and ends at the same motion in both; the rest
    # behind it, as gravity cannot be interpolated at the ends.
    whole = round(delay * rate) / rate
    pair = shift_back(desired, handle, rate, whole)
    return shift_back(*comparable(*pair, high_pass_frequency, rate), rate, delay - whole)


def _advanced(values: FloatArray, samples: float) -> FloatArray:
    """Shift a signal to earlier times by a fraction of a sample."""
    from scipy import fft

    # A length without large prime factors: others take many times as long.
    length = fft.next_fast_len(len(values) + FRACTION_EDGE, real=True)
    spectrum = fft.rfft(values.T, length)
    turned = spectrum * np.exp(2j * np.pi * np.arange(spectrum.shape[-1]) / length * samples)
    return np.asarray(fft.irfft(turned, length).T[: len(values)])
