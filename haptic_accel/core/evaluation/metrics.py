# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics of the paper: how closely an actual acceleration follows the desired one.

The paper is McMahan and Kuchenbecker, "Haptic display of realistic tool contact via dynamically
compensated control of a dedicated actuator", IROS 2009.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import check_positive_rate

PAPER_DELAY = 1.0e-3
"""Time by which the actual acceleration is shifted back before comparing, s: tau_d, Table I."""

_ERRORS = {  # none, constant, dynamic
    "plywood": (99.6, 69.8, 65.1),
    "text": (99.5, 80.6, 73.2),
    "vinyl": (99.3, 92.3, 82.8),
    "average": (99.5, 79.1, 72.0),
}

TABLE_II: Mapping[tuple[str, str], float] = MappingProxyType(
    {
        (surface, controller): error
        for surface, errors in _ERRORS.items()
        for controller, error in zip(("none", "constant", "dynamic"), errors, strict=True)
    }
)
"""The paper's Table II: NRMSE in percent by (surface, controller).

The surface ``average`` is the paper's own column of averages. It is not the plain mean of the
three surfaces, which would be 80.9 for constant and 73.7 for dynamic.
"""

REGRESSION: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"constant": (0.60, 0.65), "dynamic": (0.64, 0.71)}
)
"""The paper's slope, of desired on actual acceleration, and R^2, averaged over its surfaces.

The paper does not say which way it regressed; only so do its numbers agree with Table II, since
NRMSE^2 = 1 - 2 b + b^2 / R^2 with b = R^2 / slope of actual on desired.
"""

SEGMENT_SECONDS = 0.25
"""Maximum length of the segments of a spectrum, s: lines 4 Hz apart."""

_LARGEST = 1.0e100  # a rig that diverges reaches this on its way to infinity
_SMALLEST = 1.0e-100  # root sum of squares; together these keep every ratio finite

_FEWEST_SEGMENTS = 4  # without overlap; the coherence of a single segment is 1 whatever it holds


@dataclass(frozen=True)
class Regression:
    """Least-squares straight lines between two signals, in both directions.

    The product of the two slopes is `r2`.

    Attributes
    ----------
    slope_desired_on_actual : float
        Slope of desired = slope * actual + constant, with the least error in desired.
    slope_actual_on_desired : float
        Slope of actual = slope * desired + constant, with the least error in actual.
    r2 : float
        Square of the correlation coefficient, 0 to 1.
    """

    slope_desired_on_actual: float
    slope_actual_on_desired: float
    r2: float


@dataclass(frozen=True)
class Spectra:
    """Amplitude spectral densities of two accelerations, and their coherence.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Evenly spaced from 0 to half the sampling rate, Hz.
    desired, actual : ndarray, shape (n,)
        One-sided amplitude spectral density, m/s^2/sqrt(Hz).
    coherence : ndarray, shape (n,)
        Magnitude-squared coherence, 0 to 1; 0 where either signal has nothing.
    """

    frequency: FloatArray
    desired: FloatArray
    actual: FloatArray
    coherence: FloatArray


@dataclass(frozen=True)
class Evaluation:
    """Metrics of the paper for one condition; all are finite.

    Attributes
    ----------
    nrmse_percent : float
        RMS(actual - desired) / RMS(desired) after the shift, in percent (Table II).
    slope_desired_on_actual, slope_actual_on_desired, r2 : float
        See `Regression`. The averages that the paper states agree with its Table II only as
        slopes of desired on actual.
    """

    nrmse_percent: float
    slope_desired_on_actual: float
    slope_actual_on_desired: float
    r2: float


def align(desired: FloatArray, actual: FloatArray, samples: int) -> tuple[FloatArray, FloatArray]:
    """Shift the actual signal back, so that a response coincides with its cause.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Signals sampled at the same times.
    samples : int
        Number of samples by which `actual` lags; not negative, less than n.

    Returns
    -------
    tuple of ndarray, each of shape (n - samples,)
        ``desired[:n - samples]`` and ``actual[samples:]``, as views.

    Raises
    ------
    ValueError
        The signals differ in length, or `samples` is out of range.
    """
    _check_pair(desired, actual)
    length = len(desired)
    if not 0 <= samples < length:
        raise ValueError(f"samples = {samples}: must be from 0 to less than the length, {length}")
    return desired[: length - samples], actual[samples:]


def nrmse(desired: FloatArray, actual: FloatArray) -> float:
    """Root-mean-square error as a fraction of the desired signal's root mean square.

    The measure of the paper's Table II: RMS(actual - desired) / RMS(desired). No mean is removed.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Signals already aligned, in the same unit.

    Returns
    -------
    float
        A ratio: 0 for equal signals, 1 for an actual signal of zero.

    Raises
    ------
    ValueError
        The signals differ in length, are empty, hold NaN or infinity, or `desired` is all zero.
    """
    _check_pair(desired, actual)
    reference = float(np.linalg.norm(desired))
    if reference < _SMALLEST:
        raise ValueError("desired: is zero throughout, no error can be relative to it")
    return float(np.linalg.norm(actual - desired)) / reference


def regress(desired: FloatArray, actual: FloatArray) -> Regression:
    """Fit straight lines between two signals by least squares, in both directions.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Signals already aligned.

    Returns
    -------
    Regression
        Always finite. A constant signal explains nothing and is explained by nothing: both
        slopes and `r2` are then 0. Where that leaves the slope undetermined (regressing on the
        constant) it is the least-squares solution of smallest magnitude.

    Raises
    ------
    ValueError
        The signals differ in length, are empty, or hold NaN or infinity.
    """
    _check_pair(desired, actual)
    varying_desired, varying_actual = _without_mean(desired), _without_mean(actual)
    norm_desired = float(np.linalg.norm(varying_desired))
    norm_actual = float(np.linalg.norm(varying_actual))
    if norm_desired < _SMALLEST or norm_actual < _SMALLEST:
        return Regression(0.0, 0.0, 0.0)
    correlation = float(np.dot(varying_desired / norm_desired, varying_actual / norm_actual))
    correlation = min(max(correlation, -1.0), 1.0)  # rounding may carry it past one
    return Regression(
        slope_desired_on_actual=correlation * norm_desired / norm_actual,
        slope_actual_on_desired=correlation * norm_actual / norm_desired,
        r2=correlation**2,
    )


def spectra(desired: FloatArray, actual: FloatArray, rate: float) -> Spectra:
    """Estimate the spectra of two signals by Welch's method.

    Hann-windowed segments of `SEGMENT_SECONDS`, or of a quarter of a shorter signal, overlap by
    half; the mean is removed.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Accelerations, m/s^2; at least 16 samples.
    rate : float
        Samples per second.

    Returns
    -------
    Spectra
        Densities whose square integrates to the variance of the signal.

    Raises
    ------
    ValueError
        The signals differ in length, are too short, hold NaN or infinity, or `rate` is not
        positive.
    """
    _check_pair(desired, actual, fewest=4 * _FEWEST_SEGMENTS)
    check_positive_rate(rate)
    quarter = len(desired) // _FEWEST_SEGMENTS
    segment = min(max(math.ceil(SEGMENT_SECONDS * rate), 4), quarter)
    first, second = _without_mean(desired), _without_mean(actual)
    # Loading it takes a second, which a node that never evaluates does without.
    from scipy import signal

    frequency, power_desired = signal.welch(first, rate, nperseg=segment)
    _, power_actual = signal.welch(second, rate, nperseg=segment)
    _, cross = signal.csd(first, second, rate, nperseg=segment)
    # scipy.signal.coherence divides zero by zero where a signal has nothing.
    amplitudes = np.sqrt(power_desired) * np.sqrt(power_actual)
    coherence = np.zeros_like(amplitudes)
    np.divide(np.abs(cross), amplitudes, out=coherence, where=amplitudes > 0.0)
    return Spectra(
        frequency=np.asarray(frequency, dtype=np.float64),
        desired=np.sqrt(power_desired),
        actual=np.sqrt(power_actual),
        coherence=np.minimum(coherence, 1.0) ** 2,
    )


def evaluate(
    desired: FloatArray, actual: FloatArray, rate: float, delay: float = PAPER_DELAY
) -> Evaluation:
    """Compare an actual with a desired acceleration as the paper does.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Desired and actual handle acceleration, sampled at the same times, m/s^2.
    rate : float
        Samples per second.
    delay : float
        Time that the actual signal is shifted back, s; taken to the nearest whole number of
        samples, so that the paper's 1 ms at 1 kHz is one sample.

    Returns
    -------
    Evaluation
        Error in percent, both slopes and R^2.

    Raises
    ------
    ValueError
        The signals differ in length, leave fewer than two samples after the shift, hold NaN or
        infinity, `desired` is all zero, or `rate` or `delay` is out of range.
    """
    check_positive_rate(rate)
    if not (math.isfinite(delay) and delay >= 0.0):
        raise ValueError(f"delay = {delay}: must be at least 0 s")
    shift = math.floor(delay * rate + 0.5)
    _check_pair(desired, actual, fewest=shift + 2)
    desired, actual = align(desired, actual, shift)
    return Evaluation(100.0 * nrmse(desired, actual), **vars(regress(desired, actual)))


def _without_mean(values: FloatArray) -> FloatArray:
    """Subtract the mean; a constant gives exact zeros, not the rounding of its mean."""
    if np.ptp(values) == 0.0:
        return np.zeros_like(values)
    return values - np.mean(values)


def _check_pair(desired: FloatArray, actual: FloatArray, fewest: int = 1) -> None:
    for name, values in (("desired", desired), ("actual", actual)):
        if values.ndim != 1:
            raise ValueError(f"{name}: has {values.ndim} dimensions, must have one")
    if len(desired) != len(actual):
        raise ValueError(
            f"desired and actual: have {len(desired)} and {len(actual)} samples, must be equal"
        )
    if len(desired) < fewest:
        raise ValueError(f"desired and actual: {len(desired)} samples, must be at least {fewest}")
    for name, values in (("desired", desired), ("actual", actual)):
        if not (np.abs(values) <= _LARGEST).all():
            raise ValueError(f"{name}: holds NaN, infinity or a value beyond {_LARGEST:g}")
