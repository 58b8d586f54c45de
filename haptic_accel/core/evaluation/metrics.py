# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metrics of two accelerations: delay, error, direction, discrimination, reductions to one axis.

The paper is McMahan and Kuchenbecker, "Haptic display of realistic tool contact via dynamically
compensated control of a dedicated actuator", IROS 2009.

A signal has shape (n,) for one axis, and (n, k) for the components of a vector. The power of a
vector is the sum of its components' powers, so that every metric of a vector with one component is
that of the component.

Discrimination: `indistinguishable` is the share of an acceleration whose strength a hand cannot
distinguish from the desired one.

Desired and actual acceleration are cut into cells of half a second and a third of an octave. A
cell counts if a hand would perceive at least one of the two. They are indistinguishable in a cell
if their levels differ by less than the just noticeable difference. False vibration, where none is
desired, and missing vibration count as distinguishable.

The share only compares strength by frequency and time. It ignores phase and waveform:
an inverted or slightly delayed copy has a share of 1, and an unrelated noise of the same spectrum
up to two thirds. It also ignores masking, adaptation and practice. The NRMSE covers phase and
waveform.

The power of all axes of a vector is added in each cell, as if the hand perceived the strength of a
vibration regardless of its direction. DFT321 assumes the same (Landin, Romano, McMahan,
Kuchenbecker, EuroHaptics 2010). It is an approximation: direction is among the causes for which
Brisben, Hsiao and Johnson (J. Neurophysiol. 81, 1999) found different thresholds, and people
distinguished vibration in three axes from its reductions to one axis (Lee, Tombak, Park,
Kuchenbecker, IEEE Transactions on Haptics 15(3), 2022). `direction_error` covers the direction.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from haptic_accel.core.axes import REDUCTIONS, PrincipalDirection
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, comparable, high_passed
from haptic_accel.core.model import ComplexArray, FloatArray, vector
from haptic_accel.core.parameters import check_positive_rate

LONGEST_DELAY = 20e-3
"""Maximum lag searched, either way, s: twenty times the paper's, one period of 50 Hz."""

FRACTION_EDGE = 32
"""Number of samples dropped at each end after a shift by a fraction of a sample, as interpolation
needs neighbours on both sides."""

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
    lag, maximum = _between_samples(cross, length, peak)
    found = min(maximum / scale, 1.0)
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
    """Return desired and actual acceleration without the hand's own motion, aligned by a delay.

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
        See `shift_back` for the conditions.
    """
    # Shift by whole samples before the filter, so that both signals start and end at the same
    # motion. Shift by the rest after the filter, as gravity cannot be interpolated at the ends.
    whole = round(delay * rate) / rate
    pair = shift_back(desired, handle, rate, whole)
    return shift_back(*comparable(*pair, high_pass_frequency, rate), rate, delay - whole)


def _advanced(values: FloatArray, samples: float) -> FloatArray:
    """Shift a signal to earlier times by a fraction of a sample."""
    from scipy import fft

    # The FFT is many times slower for lengths with large prime factors.
    length = fft.next_fast_len(len(values) + FRACTION_EDGE, real=True)
    spectrum = fft.rfft(values.T, length)
    turned = spectrum * np.exp(2j * np.pi * np.arange(spectrum.shape[-1]) / length * samples)
    return np.asarray(fft.irfft(turned, length).T[: len(values)])


PAPER_DELAY = 1.0e-3
"""Shift of the actual acceleration before the comparison, s: tau_d, Table I."""

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
"""Table II of the paper: NRMSE in percent by (surface, controller).

The surface ``average`` is the column of averages in the paper. It differs from the mean of the
three surfaces, which would be 80.9 for constant and 73.7 for dynamic.
"""

REGRESSION: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"constant": (0.60, 0.65), "dynamic": (0.64, 0.71)}
)
"""Slope of desired over actual acceleration and R^2 in the paper, averaged over its surfaces.

The paper states no direction of regression. Only this direction agrees with Table II, as NRMSE^2 =
1 - 2 b + b^2 / R^2 with b = R^2 / slope of actual over desired.
"""

SEGMENT_SECONDS = 0.25
"""Maximum length of the segments of a spectrum, s: lines 4 Hz apart."""

_LARGEST = 1.0e100  # a diverging rig reaches this value before infinity
_SMALLEST = 1.0e-100  # root sum of squares; both limits together keep all ratios finite

DIRECTION_SHARE = 0.5
"""Minimum length of a desired acceleration whose direction counts, as a fraction of its root
mean square (assumed). Shorter vectors occur at zero crossings, where noise rotates the actual
vector."""

_FEWEST_SEGMENTS = 4  # not overlapping; the coherence of a single segment is 1


@dataclass(frozen=True)
class Regression:
    """Least-squares lines between two signals, in both directions.

    The product of the two slopes is `r2`. The components of a vector share one slope, and each has
    its own constant.

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

    For vectors these are the roots of the power of all components together. The coherence is then
    the share of the power that one linear filter for all components explains.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Evenly spaced from 0 to half the sampling rate, Hz.
    desired, actual : ndarray, shape (n,)
        One-sided amplitude spectral density, m/s^2/sqrt(Hz).
    coherence : ndarray, shape (n,)
        Magnitude-squared coherence, 0 to 1; 0 where a signal is zero.
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
        See `Regression`. The paper's averages agree with its Table II only as slopes of desired
        over actual.
    """

    nrmse_percent: float
    slope_desired_on_actual: float
    slope_actual_on_desired: float
    r2: float


def align(desired: FloatArray, actual: FloatArray, samples: int) -> tuple[FloatArray, FloatArray]:
    """Shift the actual signal back, so that a response coincides with its cause.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Signals sampled at the same times.
    samples : int
        Number of samples by which `actual` lags; not negative, less than n.

    Returns
    -------
    tuple of ndarray, each of n - samples samples
        ``desired[:n - samples]`` and ``actual[samples:]``, as views.

    Raises
    ------
    ValueError
        The signals differ in length, or `samples` is out of range.
    """
    check_pair(desired, actual)
    length = len(desired)
    if not 0 <= samples < length:
        raise ValueError(f"samples = {samples}: must be from 0 to less than the length, {length}")
    return desired[: length - samples], actual[samples:]


def nrmse(desired: FloatArray, actual: FloatArray) -> float:
    """Return the root-mean-square error relative to the desired signal's root mean square.

    This is the measure of the paper's Table II: RMS(actual - desired) / RMS(desired). No mean is
    removed. For vectors, it is the ratio of the root mean squares of their lengths.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Aligned signals in the same unit.

    Returns
    -------
    float
        Ratio: 0 for equal signals, 1 for an actual signal of zero.

    Raises
    ------
    ValueError
        The signals differ in length, are empty or not finite, or `desired` is zero throughout.
    """
    check_pair(desired, actual)
    reference = float(np.linalg.norm(desired))
    if reference < _SMALLEST:
        raise ValueError("desired: is zero throughout, no error can be relative to it")
    return float(np.linalg.norm(actual - desired)) / reference


def regress(desired: FloatArray, actual: FloatArray) -> Regression:
    """Fit least-squares lines between two signals, in both directions.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Aligned signals.

    Returns
    -------
    Regression
        Always finite. For a constant signal both slopes and `r2` are 0, as it explains nothing.
        Where the slope is undetermined (regression on the constant), this is the least-squares
        solution of smallest magnitude.

    Raises
    ------
    ValueError
        The signals differ in length, are empty, or hold NaN or infinity.
    """
    check_pair(desired, actual)
    varying_desired, varying_actual = _without_mean(desired).ravel(), _without_mean(actual).ravel()
    norm_desired = float(np.linalg.norm(varying_desired))
    norm_actual = float(np.linalg.norm(varying_actual))
    if norm_desired < _SMALLEST or norm_actual < _SMALLEST:
        return Regression(0.0, 0.0, 0.0)
    correlation = float(np.dot(varying_desired / norm_desired, varying_actual / norm_actual))
    correlation = min(max(correlation, -1.0), 1.0)  # rounding may make it exceed one
    return Regression(
        slope_desired_on_actual=correlation * norm_desired / norm_actual,
        slope_actual_on_desired=correlation * norm_actual / norm_desired,
        r2=correlation**2,
    )


def spectra(desired: FloatArray, actual: FloatArray, rate: float) -> Spectra:
    """Estimate the spectra of two signals by Welch's method.

    Hann-windowed segments of `SEGMENT_SECONDS`, or a quarter of a shorter signal, overlap by half.
    The mean is removed.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
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
    check_pair(desired, actual, fewest=4 * _FEWEST_SEGMENTS)
    check_positive_rate(rate)
    quarter = len(desired) // _FEWEST_SEGMENTS
    segment = min(max(math.ceil(SEGMENT_SECONDS * rate), 4), quarter)
    first, second = _without_mean(desired), _without_mean(actual)
    # Its import takes a second, which nodes without an evaluation avoid.
    from scipy import signal

    pairs = list(zip(components(first), components(second), strict=True))
    frequency, _ = signal.welch(pairs[0][0], rate, nperseg=segment)
    power_desired = sum(signal.welch(one, rate, nperseg=segment)[1] for one, _ in pairs)
    power_actual = sum(signal.welch(other, rate, nperseg=segment)[1] for _, other in pairs)
    cross = sum(signal.csd(*pair, rate, nperseg=segment)[1] for pair in pairs)
    # scipy.signal.coherence divides zero by zero where a signal is zero.
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
    """Compare an actual with a desired acceleration by the paper's method.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Desired and actual handle acceleration, sampled at the same times, m/s^2.
    rate : float
        Samples per second.
    delay : float
        Shift of the actual signal, s, rounded to whole samples: the paper's 1 ms at 1 kHz is one
        sample.

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
    check_pair(desired, actual, fewest=shift + 2)
    desired, actual = align(desired, actual, shift)
    return Evaluation(100.0 * nrmse(desired, actual), **vars(regress(desired, actual)))


NO_EVALUATION = Evaluation(math.nan, math.nan, math.nan, math.nan)
"""Evaluation of an axis without desired vibration."""


def evaluate_axes(desired: FloatArray, actual: FloatArray, rate: float) -> list[Evaluation]:
    """Compare the components of an actual with those of a desired acceleration.

    Parameters
    ----------
    desired, actual : ndarray, shape (n, k)
        Aligned accelerations, m/s^2.
    rate : float
        Samples per second.

    Returns
    -------
    list of Evaluation
        Errors relative to the same component of `desired`; `NO_EVALUATION` for a component with
        less than `QUIET_SHARE` of the vector's power.

    Raises
    ------
    ValueError
        See `evaluate` for the conditions.
    """
    least = QUIET_SHARE * float(np.sum(desired**2))
    return [
        evaluate(one, other, rate, 0.0) if np.sum(one**2) > least else NO_EVALUATION
        for one, other in zip(components(desired), components(actual), strict=True)
    ]


def direction_error(desired: FloatArray, actual: FloatArray) -> float:
    """Return the median angle between actual and desired acceleration.

    Only samples count whose desired acceleration is at least `DIRECTION_SHARE` of its root mean
    square. The angle is between vectors, 0 to 180 degrees, and 180 for an inverted vibration. An
    angle between lines would be 0 although handle and tool move in opposite directions.

    Parameters
    ----------
    desired, actual : ndarray, shape (n, k)
        Aligned accelerations, m/s^2.

    Returns
    -------
    float
        Angle, degrees; NaN if no sample counts, or the actual acceleration is zero in all of them.

    Raises
    ------
    ValueError
        The signals differ in shape, are empty or not finite.

    Examples
    --------
    >>> wave = np.sin(np.arange(100.0))[:, np.newaxis]
    >>> round(direction_error(wave * [0.0, 0.0, 1.0], wave * [0.0, 1.0, 1.0]), 9)
    45.0
    """
    check_pair(desired, actual)
    long, found = lengths(desired), lengths(actual)
    counted = (long >= DIRECTION_SHARE * np.sqrt(np.mean(long**2))) & (long > 0.0) & (found > 0.0)
    if not counted.any():
        return math.nan
    one = desired[counted] / long[counted, np.newaxis]
    other = actual[counted] / found[counted, np.newaxis]
    # Unlike the arc cosine of the product, this is exact for small angles (Kahan).
    angles = 2.0 * np.arctan2(lengths(one - other), lengths(one + other))
    return math.degrees(float(np.median(angles)))


def components(values: FloatArray) -> list[FloatArray]:
    """Return the components of a signal, shape (n,) each; for one axis, the signal itself."""
    return [values] if values.ndim == 1 else [np.ascontiguousarray(one) for one in values.T]


def by_component(function: Callable[[FloatArray], FloatArray], values: FloatArray) -> FloatArray:
    """Apply a function of one axis to each component of a signal."""
    found = [function(one) for one in components(values)]
    return found[0] if values.ndim == 1 else np.column_stack(found)


def lengths(values: FloatArray) -> FloatArray:
    """Return the length of each vector, shape (n,); the magnitude for one axis."""
    return np.abs(values) if values.ndim == 1 else np.asarray(np.linalg.norm(values, axis=1))


def _without_mean(values: FloatArray) -> FloatArray:
    """Subtract the mean of each axis; a constant signal gives exact zeros."""
    return np.where(np.ptp(values, axis=0) == 0.0, 0.0, values - np.mean(values, axis=0))


def check_pair(desired: FloatArray, actual: FloatArray, fewest: int = 1) -> None:
    """Check that two signals can be compared.

    Raises
    ------
    ValueError
        The signals differ in length or axes, have fewer than `fewest` samples or more than two
        dimensions, or hold NaN, infinity or a huge value.
    """
    for name, values in (("desired", desired), ("actual", actual)):
        if values.ndim not in (1, 2):
            raise ValueError(f"{name}: has {values.ndim} dimensions, must have one or two")
    if len(desired) != len(actual):
        raise ValueError(
            f"desired and actual: have {len(desired)} and {len(actual)} samples, must be equal"
        )
    if desired.shape != actual.shape:
        raise ValueError(
            f"desired and actual: have {desired.size} and {actual.size} numbers, must be equal"
        )
    if len(desired) < fewest:
        raise ValueError(f"desired and actual: {len(desired)} samples, must be at least {fewest}")
    for name, values in (("desired", desired), ("actual", actual)):
        if not (np.abs(values) <= _LARGEST).all():
            raise ValueError(f"{name}: holds NaN, infinity or a value beyond {_LARGEST:g}")


BAND_EDGES = (15.0, 30.0, 60.0, 125.0, 250.0, 500.0, 1000.0, 2000.0)
"""Octaves above the paper's high-pass corner, Hz, rounded as octave bands are (IEC 61260). Fingers
are most sensitive in the middle bands. The paper's spectra are similar up to about 300 Hz."""

assert BAND_EDGES[0] == HIGH_PASS_FREQUENCY

QUIET_SHARE = 1e-6
"""Fraction of the desired signal's power below which a band has no relative error. A thousandth of
the amplitude is below the sensor's noise."""


@dataclass(frozen=True)
class Band:
    """Frequencies from `low` (included) to `high` (excluded), Hz."""

    low: float
    high: float

    @property
    def name(self) -> str:
        """Name of the band, for example ``30-60 Hz``."""
        return f"{self.low:g}-{self.high:g} Hz"


def bands(rate: float) -> tuple[Band, ...]:
    """Return the bands up to half the sampling rate, which ends the last band; rate in Hz."""
    half = rate / 2
    edges = [edge for edge in BAND_EDGES if edge < half] + [min(half, BAND_EDGES[-1])]
    edges = list(dict.fromkeys(edges))
    return tuple(Band(low, high) for low, high in itertools.pairwise(edges))


def band_nrmse(
    desired: FloatArray, actual: FloatArray, rate: float, chosen: Sequence[Band]
) -> dict[str, float]:
    """Return the error within frequency bands.

    For each band, the error is the root of the power of (actual - desired) over the power of
    desired, from `metrics.spectra`. By Parseval's theorem it equals `metrics.nrmse` of both
    signals after an ideal zero-phase band filter.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Aligned signals, m/s^2; at least 16 samples.
    rate : float
        Samples per second.
    chosen : sequence of Band

    Returns
    -------
    dict
        Ratio by the band's name; NaN if the desired signal is below `QUIET_SHARE`, or the spectrum
        has no line.

    Raises
    ------
    ValueError
        See `spectra` for the conditions.
    """
    found = spectra(desired, actual - desired, rate)
    desired_power, wrong = found.desired**2, found.actual**2
    least = QUIET_SHARE * float(np.sum(desired_power))
    errors = {}
    for band in chosen:
        within = (found.frequency >= band.low) & (found.frequency < band.high)
        reference = float(np.sum(desired_power[within]))
        error = float(np.sum(wrong[within]))
        errors[band.name] = math.sqrt(error / reference) if reference > least else math.nan
    return errors


DETECTION = ((10.0, 26e-6), (20.0, 8.5e-6), (160.0, 0.065e-6), (320.0, 0.06e-6))
"""Detection threshold of a vibrating stylus held like a pen: frequency, Hz, and amplitude of the
displacement (peak), m.

Israr, Choi and Tan, "Detection threshold and mechanical impedance of the hand in a pen-hold
posture", IROS 2006: 10 people, sines of 1 s along the stylus, 10 to 500 Hz. The text states 26 um
at 10 Hz, 8.5 um at 20 Hz, a mean slope of -13 dB per octave from 10 to 160 Hz, which gives
0.065 um at 160 Hz, and the minimum, 0.06 um at 320 Hz. These numbers come from a summary of the
paper (github.com/adambickerdike/Stabilisation_Pen, HAP-27); its figure, with the value at 500 Hz,
was not available. Beyond 320 Hz the minimum is used, so that too many cells count rather than too
few.
"""

JUST_NOTICEABLE = 2.2
"""Just noticeable difference of vibration level, dB.

Israr et al., "Tactual frequency and amplitude discrimination with fixed and roving background",
HAPTICS 2006, 10.1109/HAPTIC.2006.1627110: 2.2 to 2.5 dB for sines of 2 to 200 Hz at the fingertip,
20 to 35 dB above threshold; more if another vibration is present.
"""

CELL = 0.5
"""Duration of a cell, s. Its spectral lines, 2 Hz apart, resolve the lowest band, 4.6 Hz wide."""

CENTRES: FloatArray = 1000.0 * 10.0 ** (np.arange(-17, -2) / 10.0)
"""Centres of the third-octave bands (IEC 61260, base ten), 20 to 500 Hz: above the compensator's
high-pass corner, and up to the highest frequency of `DETECTION`'s source."""

_EDGE_RATIO = 10.0**0.05  # ratio of a band's upper edge to its centre


def detection_threshold(frequency: FloatArray) -> FloatArray:
    """Return the acceleration of a stylus that a hand just detects.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Frequencies, Hz.

    Returns
    -------
    ndarray, shape (n,)
        Root mean square of a sine, m/s^2. Between the points of `DETECTION`, log displacement is
        interpolated over log frequency; beyond them, the displacement is constant.

    Examples
    --------
    >>> detection_threshold(np.array([20.0, 160.0, 320.0])).round(2)
    array([0.09, 0.05, 0.17])
    """
    known, displacement = np.log(np.array(DETECTION)).T
    peak = np.exp(np.interp(np.log(frequency), known, displacement))
    return np.asarray((2.0 * np.pi * frequency) ** 2 * peak / math.sqrt(2.0))


def indistinguishable(desired: FloatArray, actual: FloatArray, rate: float) -> float:
    """Return the share of cells in which a hand cannot distinguish actual from desired.

    A cell is half a second in a Hann window, overlapping by half, within a third-octave band. It
    counts if the level of one of the accelerations reaches `detection_threshold`. Its levels are
    indistinguishable if they differ by at most `JUST_NOTICEABLE`.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Aligned accelerations without gravity, m/s^2.
    rate : float
        Samples per second; bands beyond half of it are omitted.

    Returns
    -------
    float
        Share from 0 to 1; NaN if no cell counts, or the signals are shorter than a cell.

    Raises
    ------
    ValueError
        The signals differ in length, are empty or not finite, or `rate` is not positive.

    Examples
    --------
    >>> tone = np.sin(2 * np.pi * 100 * np.arange(2000) / 1000.0)
    >>> indistinguishable(tone, 1.2 * tone, 1000.0), indistinguishable(tone, 1.4 * tone, 1000.0)
    (1.0, 0.0)
    """
    check_pair(desired, actual)
    check_positive_rate(rate)
    centres = CENTRES[rate / 2 >= CENTRES * _EDGE_RATIO]
    first, second = (
        sum(_powers(component, centres, rate) for component in components(signal))
        for signal in (desired, actual)
    )
    perceptible = np.maximum(first, second) >= detection_threshold(centres) ** 2
    if not perceptible.any():
        return math.nan
    ratio = 10.0 ** (JUST_NOTICEABLE / 10.0)
    alike = (first <= ratio * second) & (second <= ratio * first)
    return float(np.mean(alike[perceptible]))


def _powers(signal: FloatArray, centres: FloatArray, rate: float) -> FloatArray:
    """Return the mean square of each cell (rows) in each band (columns), (m/s^2)^2."""
    length = round(CELL * rate)
    if len(signal) < length or not len(centres):
        return np.zeros((0, len(centres)))
    window = np.hanning(length + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(signal, length)[:: length // 2]
    lines = np.abs(np.fft.rfft(pieces * window)) ** 2 * (2.0 / (length * np.sum(window**2)))
    frequency = np.fft.rfftfreq(length, 1.0 / rate)[:, np.newaxis]
    within = (frequency >= centres / _EDGE_RATIO) & (frequency < centres * _EDGE_RATIO)
    return np.asarray(lines @ within)


LIVE_PRINCIPAL = "principal, live"
"""Name of the reduction by `PrincipalDirection`. All other reductions are the same live and for a
whole recording."""


def kept_powers(acceleration: FloatArray, rate: float) -> dict[str, float]:
    """Return the power that each reduction to one signal keeps of a vibration in three axes.

    The power is relative to that of all three axes, above the compensation's high-pass, which also
    removes hand motion and gravity; 1 if nothing is lost, NaN without vibration.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
        Acceleration of the tool, m/s^2.
    rate : float
        Samples per second, above 30 Hz.

    Examples
    --------
    >>> wave = np.sin(2 * np.pi * 100 * np.arange(4000) / 1000)
    >>> for name, power in kept_powers(np.outer(wave, [0.6, 0.0, 0.8]), 1000.0).items():
    ...     print(f"{name}: {power:.2f}")
    dft321: 1.00
    principal: 1.00
    sum: 1.96
    magnitude: 0.17
    axis: 0.64
    principal, live: 0.98
    """
    moving = by_component(lambda one: high_passed(one, HIGH_PASS_FREQUENCY, rate), acceleration)
    signals = {name: reduced(moving) for name, reduced in REDUCTIONS.items()}
    live = PrincipalDirection(rate)
    signals[LIVE_PRINCIPAL] = np.array([live(vector(each)) for each in moving])
    there = float(np.sum([_band_powers(each, rate) for each in moving.T], axis=0).sum())
    return {
        name: float(_band_powers(each, rate).sum()) / there if there else math.nan
        for name, each in signals.items()
    }


def _band_powers(signal: FloatArray, rate: float) -> FloatArray:
    """Return the power of a signal in each octave of `BAND_EDGES`."""
    power = np.abs(np.fft.rfft(signal)) ** 2
    edges = np.searchsorted(np.fft.rfftfreq(len(signal), 1 / rate), BAND_EDGES)
    return np.array([power[low:high].sum() for low, high in itertools.pairwise(edges)])
