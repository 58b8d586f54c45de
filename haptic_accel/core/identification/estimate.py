# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Estimates of the handle's frequency response from recorded force and acceleration.

A discrete rational model, fitted to the recording itself, also includes dynamics that the physical
model lacks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from haptic_accel.core.handle.plant import DiscreteModel
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.parameters import ParameterError, check_positive_rate

# scipy.signal takes half a second to import: only an estimate needs it.

Band = tuple[float, float]
Values = TypeVar("Values", FloatArray, ComplexArray)

SEGMENT_SECONDS = 0.5
"""Length of the segments of averaged estimates, s; the spectral lines are 2 Hz apart."""

SMALLEST_FORCE = 0.01
"""Minimum root mean square of the excitation force, N (assumed; a dozen steps of the paper's
14-bit converter)."""

LARGEST_SATURATED_SHARE = 1e-3
"""Maximum accepted fraction of samples at the limits of the sensor's range (assumed)."""

SMALLEST_COHERENCE = 0.7
"""Mean coherence over the band below which a recording is rejected (assumed; Table I with
the paper's sweep and accelerometer has 0.99)."""

_FEWEST_SEGMENTS = 4  # not overlapping; the coherence of a single segment is 1

NOISE_LINES = 25
"""Lines over which the noise is averaged. Two repeats give each line's noise with an uncertainty
of 100 %; for 25 lines it is 20 %. Noise is smooth in frequency."""

_HANN_OVERLAP = 1.0 / 36.0
"""Squared correlation of Hann-windowed segments that overlap by half (Welch 1967)."""

_AT_RANGE = 0.999  # relative to full range: a converter's last step may be slightly less


SMALLER = {"start_amplitude": 0.5, "end_amplitude": 0.5}
"""Factors that reduce a sweep's parameters after excessive travel, force or acceleration."""


class RecordingError(ValueError):
    """Recording that is not fit for identification.

    Parameters
    ----------
    reason : str
        Reason for the rejection, one line.
    factors : mapping of str to float, optional
        Factors to apply to the sweep's parameters for the next recording, where known.
    """

    def __init__(self, reason: str, factors: Mapping[str, float] | None = None) -> None:
        super().__init__(reason)
        self.factors = dict(factors or {})


@dataclass(frozen=True)
class FrequencyResponse:
    """Estimated response of handle acceleration to actuator force.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Increasing frequencies, above 0, below half the rate, Hz.
    response : ndarray, shape (n,)
        Complex, m/s^2 per N.
    coherence : ndarray, shape (n,)
        Magnitude-squared coherence, 0 to 1: fraction of the acceleration's power explained by the
        force.
    rate : float
        Samples per second of the signals.
    averages : float
        Number of independent periods or segments in the mean.
    """

    frequency: FloatArray
    response: ComplexArray
    coherence: FloatArray
    rate: float
    averages: float

    @property
    def standard_deviation(self) -> FloatArray:
        """Standard deviation of the real and of the imaginary part, m/s^2 per N, shape (n,).

        For Gaussian noise in the acceleration; see Bendat and Piersol, Random Data, chapter 9.
        """
        noise_to_signal = (1.0 - self.coherence) / np.maximum(self.coherence, _TINY)
        return np.asarray(np.abs(self.response) * np.sqrt(noise_to_signal / (2.0 * self.averages)))


_TINY = 1e-12


def dft_ratio(
    force: FloatArray, acceleration: FloatArray, rate: float, band: Band, repeats: int = 2
) -> FrequencyResponse:
    """Return DFT(acceleration) / DFT(force) for a periodic force, as in the paper.

    There is no leakage once the handle has settled. The result is the mean over the repeats,
    weighted by the force's power. The noise is the difference between the repeats, smoothed over
    adjacent lines, as two repeats alone give a poor estimate.

    Parameters
    ----------
    force, acceleration : ndarray, shape (repeats * n,)
        Whole repeats, N and m/s^2, without the first one (settling); see `kept_repeats`.
    rate : float
        Samples per second.
    band : tuple of float
        Lowest and highest frequency of interest, Hz.
    repeats : int
        Number of repeats in the signals, at least 2.

    Returns
    -------
    FrequencyResponse
        At the lines of one repeat within the band at which the force is not zero.

    Raises
    ------
    ParameterError
        Band, rate or number of repeats is out of range, or no line lies in the band.
    RecordingError
        Signals differ in length, are not finite, or have no force in the band.
    """
    _check_band(rate, band)
    check_pair(force, acceleration)
    if repeats < 2 or len(force) % repeats:
        raise ParameterError(
            f"repeats = {repeats}: must be at least 2 and divide the {len(force)} samples"
        )
    samples = len(force) // repeats
    frequency: FloatArray = np.fft.rfftfreq(samples, 1.0 / rate).astype(np.float64)
    inside = _inside(frequency, band)
    spectra_force = np.fft.rfft(force.reshape(repeats, samples))
    spectra_acceleration = np.fft.rfft(acceleration.reshape(repeats, samples))
    power = np.mean(np.abs(spectra_force) ** 2, axis=0)
    cross = np.mean(np.conj(spectra_force) * spectra_acceleration, axis=0)
    strongest = float(power[inside].max())
    if strongest <= 0.0:
        raise RecordingError(f"actuator_force: zero from {band[0]:g} to {band[1]:g} Hz")
    inside &= power > _WEAKEST_LINE * strongest
    response = _ratio(cross, power)
    rest = np.abs(spectra_acceleration - response * spectra_force) ** 2
    noise = smoothed(np.sum(rest[:, inside], axis=0) / (repeats - 1))
    explained = np.abs(response[inside]) ** 2 * power[inside]
    coherence = _ratio(explained, explained + noise)
    return FrequencyResponse(frequency[inside], response[inside], coherence, rate, float(repeats))


_WEAKEST_LINE = 1e-6  # share of the strongest line's power; weaker lines are rounding errors


def h1(force: FloatArray, acceleration: FloatArray, rate: float, band: Band) -> FrequencyResponse:
    """Estimate the response for noise in the acceleration: cross spectrum over force spectrum.

    Hann-windowed segments overlap by half. Any force is suitable; `dft_ratio` needs a periodic
    force. Leakage biases resonances narrower than a line.

    Parameters
    ----------
    force, acceleration : ndarray, shape (n,)
        N and m/s^2.
    rate : float
        Samples per second.
    band : tuple of float
        Lowest and highest frequency of interest, Hz.

    Returns
    -------
    FrequencyResponse
        At the lines within the band; zero where the force is zero.

    Raises
    ------
    ParameterError
        Band or rate is out of range.
    RecordingError
        Signals differ in length, are not finite, or are too short.
    """
    from scipy import signal

    _check_band(rate, band)
    check_pair(force, acceleration)
    segment = round(SEGMENT_SECONDS * rate)
    fewest = _FEWEST_SEGMENTS * segment
    if len(force) < fewest:
        raise RecordingError(
            f"recording: {len(force)} samples at {rate:g} Hz, must be at least {fewest}"
        )
    frequency, power_force = signal.welch(force, rate, nperseg=segment)
    _, power_acceleration = signal.welch(acceleration, rate, nperseg=segment)
    _, cross = signal.csd(force, acceleration, rate, nperseg=segment)
    inside = _inside(frequency, band)
    power_force, cross = power_force[inside], cross[inside]
    coherence = _ratio(np.abs(cross) ** 2, power_force * power_acceleration[inside])
    segments = 2 * len(force) // segment - 1
    return FrequencyResponse(
        frequency=np.asarray(frequency[inside], dtype=np.float64),
        response=_ratio(cross, power_force),
        coherence=np.minimum(coherence, 1.0),
        rate=rate,
        averages=segments / (1.0 + 2.0 * _HANN_OVERLAP * (segments - 1) / segments),
    )


def h2(first: FrequencyResponse) -> FrequencyResponse:
    """Return the estimate for noise in the force: acceleration spectrum over cross spectrum.

    Parameters
    ----------
    first : FrequencyResponse
        H1 estimate of the same signals. By definition H1 is H2 times the coherence.
    """
    return replace(first, response=_ratio(first.response, first.coherence))


def check_recording(
    force: FloatArray, acceleration: FloatArray, rate: float, band: Band, acceleration_range: float
) -> None:
    """Reject a recording that is not suitable for a fit.

    Parameters
    ----------
    force, acceleration : ndarray, shape (n,)
        N and m/s^2.
    rate : float
        Samples per second.
    band : tuple of float
        Band that the force excites, Hz.
    acceleration_range : float
        Maximum acceleration of the sensor's range, both ways, m/s^2.

    Raises
    ------
    RecordingError
        The message is one line with the signal, its value, and the allowed values.
    ParameterError
        Band or rate is out of range.
    """
    coherence = float(np.mean(h1(force, acceleration, rate, band).coherence))
    excited = float(np.std(force))
    if excited < SMALLEST_FORCE:
        raise RecordingError(
            f"actuator_force: {excited:.3g} N root mean square excites nothing,"
            f" must be at least {SMALLEST_FORCE:g} N"
        )
    check_range(acceleration, acceleration_range)
    if coherence < SMALLEST_COHERENCE:
        raise RecordingError(
            f"coherence = {coherence:.2f} on average from {band[0]:g} to {band[1]:g} Hz:"
            f" must be at least {SMALLEST_COHERENCE:g}"
        )


def check_range(acceleration: FloatArray, acceleration_range: float, axis: str = "") -> None:
    """Reject an acceleration that left the sensor's range.

    Parameters
    ----------
    acceleration : ndarray, shape (n,)
        m/s^2.
    acceleration_range : float
        Maximum acceleration of the sensor's range, both ways, m/s^2.
    axis : str
        Beginning of the message.

    Raises
    ------
    RecordingError
        The message contains the fraction of the samples at the range.
    """
    share = float(np.mean(np.abs(acceleration) >= _AT_RANGE * acceleration_range))
    if share > LARGEST_SATURATED_SHARE:
        raise RecordingError(
            f"{axis}handle_acceleration: {100 * share:.2g} % of its samples are at the sensor's"
            f" range of {acceleration_range:g} m/s^2,"
            f" must be at most {100 * LARGEST_SATURATED_SHARE:g} %; use a smaller amplitude",
            SMALLER,
        )


def _inside(frequency: FloatArray, band: Band) -> npt.NDArray[np.bool_]:
    """Return the mask of the lines in a band.

    Raises
    ------
    ParameterError
        The band contains no line.
    """
    inside = np.asarray((frequency >= band[0]) & (frequency <= band[1]))
    if not inside.any():
        raise ParameterError(
            f"band = {band[0]:g} to {band[1]:g} Hz: holds no line of the spectrum"
        )
    return inside


def _ratio(numerator: Values, denominator: FloatArray) -> Values:
    """Return a quotient that is zero where the denominator is zero."""
    return np.divide(numerator, denominator, out=np.zeros_like(numerator), where=denominator > 0)


def smoothed(values: Values) -> Values:
    """Return the moving average over `NOISE_LINES` lines, or fewer at the ends."""
    window = np.ones(min(NOISE_LINES, len(values)))
    counts = np.convolve(np.ones(len(values)), window, "same")
    return np.convolve(values, window, "same") / counts


def _check_band(rate: float, band: Band) -> None:
    check_positive_rate(rate)
    low, high = band
    if not 0 < low < high < rate / 2:
        raise ParameterError(
            f"band = {low:g} to {high:g} Hz: must satisfy 0 < low < high < half the rate,"
            f" {rate / 2:g} Hz"
        )


def check_pair(force: FloatArray, acceleration: FloatArray) -> None:
    """Reject signals that do not match each other.

    Raises
    ------
    RecordingError
        Signals differ in length, are empty, not finite, or have more than one dimension.
    """
    for name, values in (("actuator_force", force), ("handle_acceleration", acceleration)):
        if values.ndim != 1:
            raise RecordingError(f"{name}: has {values.ndim} dimensions, must have one")
        if not np.isfinite(values).all():
            raise RecordingError(f"{name}: holds NaN or infinity, must be finite")
    if len(force) != len(acceleration):
        raise RecordingError(
            f"actuator_force and handle_acceleration: have {len(force)} and {len(acceleration)}"
            " samples, must be equal"
        )
    if len(force) == 0:
        raise RecordingError("recording: holds no samples")


# scipy.signal takes half a second to import: only an identification needs it.

HIGHEST_ORDER = 40
"""Maximum number of poles."""

DELAY = 1
"""Samples from a force to the first acceleration that shows it, in a loop that applies its force
after the measurement."""

ITERATIONS = 30
"""Maximum number of pole relocations; five to ten suffice."""

_LARGEST_RADIUS = 1.0 - 1e-6  # maximum pole radius: a pole on the unit circle does not decay
_CONVERGED = 1e-7  # maximum step of a pole
_FARTHEST_ZERO = 1e4  # a zero farther away is a zero at infinity with rounding errors


def identify_discrete(
    force: FloatArray, acceleration: FloatArray, order: int, rate: float
) -> DiscreteModel:
    """Identify a discrete model from a recording that starts at rest.

    The method is that of Steiglitz and McBride (IEEE Trans. Automatic Control 10, 1965), whose
    iterations are unbiased for white noise in the acceleration. They use partial fractions instead
    of powers of z (vector fitting in the time domain: Gustavsen and Semlyen, IEEE Trans. Power
    Delivery 14, 1999), which are well-conditioned even at high orders and rates. Poles outside the
    unit circle are reflected.

    Parameters
    ----------
    force, acceleration : ndarray, shape (n,)
        N and m/s^2. The mean of the acceleration is removed: it is the sensor's offset, as a
        constant force causes no acceleration.
    order : int
        Number of poles, and of zeros.
    rate : float
        Samples per second.

    Returns
    -------
    DiscreteModel
        Stable model. Its delay exceeds `DELAY` if it has fewer zeros than poles.

    Raises
    ------
    ParameterError
        Order or rate is out of range.
    RecordingError
        Signals differ in length, are too short, not finite, or constant.
    """
    _check(order, rate, force, acceleration)
    force = np.concatenate([np.zeros(DELAY), force])[: len(force)]
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
    return DiscreteModel(sections, rate, DELAY + missing)


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


def _check(order: int, rate: float, force: FloatArray, acceleration: FloatArray) -> None:
    if not 1 <= order <= HIGHEST_ORDER:
        raise ParameterError(f"order = {order}: must be from 1 to {HIGHEST_ORDER}")
    check_positive_rate(rate)
    check_pair(force, acceleration)
    fewest = 10 * (2 * order + 1) + DELAY
    if len(force) < fewest:
        raise RecordingError(
            f"recording: {len(force)} samples, must be at least {fewest} for order {order}"
        )
    for name, values in (("actuator_force", force), ("handle_acceleration", acceleration)):
        if np.ptp(values) == 0.0:
            raise RecordingError(f"{name}: is constant, which identifies nothing")
