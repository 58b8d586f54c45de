# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Frequency response of a handle with three coils: estimate, covariance, coherence, wiring faults.

The coupling of the axes is fitted over frequency, as causal impulse responses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.identification import estimate
from haptic_accel.core.identification import sweep as sweeps
from haptic_accel.core.model import ComplexArray, FloatArray
from haptic_accel.core.sampling import BoolArray

COILS = 3
"""Number of coils, and of axes of the acceleration."""

ONSET_TIME, ONSET_RIDGE, ONSET = 0.032, 0.1, 0.4
"""Length of an impulse response, s, weight of its ridge regression, and fraction of the largest
sample at which the response counts as started. Without noise they yield the correct sign for
delays up to 5 ms, low-passes from 200 Hz and modes from 120 Hz with damping ratios from 0.05 (1296
handles)."""


@dataclass(frozen=True)
class MatrixResponse:
    """Estimated response of the accelerations in three axes to the forces of three coils.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Lines of a period within the band, Hz.
    response : ndarray, shape (n, 3, 3)
        Response, m/s^2 per N; the second index is the axis of the acceleration, the third is the
        coil.
    deviation : ndarray, shape (n, 3, 3)
        Standard deviation of real and imaginary part, from the noise and the force's spectra.
    coherence : ndarray, shape (n, 3)
        Multiple coherence: fraction of an acceleration's power that all forces explain.
    shares : ndarray, shape (n, 3, 3)
        Power due to a coil over the sum of this power and that of the noise.
    rate : float
        Samples per second.
    averages : int
        Number of evaluated periods.
    lines : ndarray of bool, shape (m,)
        Mask of the lines in the spectrum of a period.
    """

    frequency: FloatArray
    response: ComplexArray
    deviation: FloatArray
    coherence: FloatArray
    shares: FloatArray
    rate: float
    averages: int
    lines: BoolArray

    def own(self, axis: int) -> estimate.FrequencyResponse:
        """Return the response of an axis to its own coil."""
        response, deviation = self.response[:, axis, axis], self.deviation[:, axis, axis]
        noise_to_signal = 2.0 * self.averages * (deviation / np.abs(response)) ** 2
        return estimate.FrequencyResponse(
            self.frequency, response, 1.0 / (1.0 + noise_to_signal), self.rate, self.averages
        )

    @property
    def cross_coupling(self) -> FloatArray:
        """Response of each axis to each coil relative to the coil's own axis, dB, shape (3, 3)."""
        power = np.mean(np.abs(self.response) ** 2, axis=0)
        return np.asarray(10 * np.log10(power / np.diag(power)))

    @property
    def condition(self) -> FloatArray:
        """Condition number of the response at each line, shape (n,)."""
        return np.asarray(np.linalg.cond(self.response))


def matrix_response(
    trials: Sequence[sweeps.IdentificationTrial], sweep: sweeps.SweepParameters
) -> MatrixResponse:
    """Estimate the response by least squares at each line over all evaluated periods.

    G = A F^H (F F^H)^-1 for the spectra A of the accelerations and F of the forces. The noise is
    the residual, smoothed over adjacent lines; its covariance is that of G times F F^H.

    Parameters
    ----------
    trials : sequence of IdentificationTrial
        Trials of `orthogonal_excitation`, without latency.
    sweep : SweepParameters

    Raises
    ------
    RecordingError
        A signal is not finite, constant, or without force.
    """
    rate = trials[0].rate
    for trial in trials:
        sweeps.check_axes(trial.actuator_force, trial.handle_acceleration)
        _check_alive(trial)
    forces, accelerations = (
        np.concatenate([sweeps.kept_periods(getattr(each, name), sweep, rate) for each in trials])
        for name in ("actuator_force", "handle_acceleration")
    )
    frequency = np.fft.rfftfreq(sweeps.repeat_samples(sweep, rate), 1.0 / rate)
    used = (frequency >= sweep.start_frequency) & (frequency <= sweep.end_frequency)
    force, acceleration = (_spectra(each)[used] for each in (forces, accelerations))
    periods = force.shape[2]
    adjoint = force.conj().swapaxes(1, 2)
    inverse = np.linalg.inv(force @ adjoint)
    response = acceleration @ adjoint @ inverse
    rest = np.sum(np.abs(acceleration - response @ force) ** 2, axis=2) / (periods - COILS)
    noise = np.stack([estimate.smoothed(each) for each in rest.T], axis=1)
    variance = np.diagonal(inverse, axis1=1, axis2=2).real
    power = np.mean(np.abs(force) ** 2, axis=2)
    # The estimate also explains a part of the noise, which must not count as coherence.
    explained = np.mean(np.abs(response @ force) ** 2, axis=2) - noise * COILS / periods
    explained = np.maximum(explained, 0.0)
    alone = np.abs(response) ** 2 - noise[:, :, np.newaxis] * variance[:, np.newaxis, :]
    alone = np.maximum(alone, 0.0) * power[:, np.newaxis, :]
    return MatrixResponse(
        np.asarray(frequency[used], dtype=np.float64),
        response,
        np.sqrt(noise[:, :, np.newaxis] * variance[:, np.newaxis, :] / 2),
        explained / (explained + noise),
        alone / (alone + noise[:, :, np.newaxis]),
        rate,
        periods,
        used,
    )


def _spectra(periods: FloatArray) -> ComplexArray:
    """Return the spectra of periods (realisations, repeats, n, 3) as (lines, 3, all periods)."""
    spectra = np.fft.rfft(periods, axis=2)
    return np.moveaxis(spectra.reshape(-1, *spectra.shape[2:]), 0, 2)


def _check_alive(trial: sweeps.IdentificationTrial) -> None:
    """Reject a force without excitation, and an acceleration that does not change."""
    for axis, force in sweeps.by_axis(trial.actuator_force):
        if (excited := float(np.std(force))) < estimate.SMALLEST_FORCE:
            raise estimate.RecordingError(
                f"{axis}actuator_force: {excited:.3g} N root mean square excites nothing, must be"
                f" at least {estimate.SMALLEST_FORCE:g} N"
            )
    for axis, values in sweeps.by_axis(trial.handle_acceleration):
        if np.ptp(values) == 0.0:
            raise estimate.RecordingError(
                f"{axis}handle_acceleration: constant at {values[0]:.3g} m/s^2, must change; is"
                " the sensor's axis connected?"
            )


def check_matrix_response(
    found: MatrixResponse, trials: Sequence[sweeps.IdentificationTrial], acceleration_range: float
) -> None:
    """Reject a response to which no plant can be fitted; check each axis.

    Parameters
    ----------
    found : MatrixResponse
    trials : sequence of IdentificationTrial
        Trials that the response was estimated from.
    acceleration_range : float
        Range of the sensor, both ways, m/s^2.

    Raises
    ------
    RecordingError
        A sensor's axis is saturated or not coherent with the forces, or a coil has no current,
        acts backwards, or is swapped with another. The message names the axis.
    """
    for trial in trials:
        for axis, values in sweeps.by_axis(trial.handle_acceleration):
            estimate.check_range(values, acceleration_range, axis)
    band = found.frequency[0], found.frequency[-1]
    _check_coherence(found, band)
    _check_directions(found)
    for coil, name in enumerate(NAMES):
        if _pushes_back(found, coil):
            raise estimate.RecordingError(
                f"axis {name}: its coil pushes against the axis, must push along it; swap the"
                " coil's wires, or make its force constant negative"
            )


def _check_coherence(found: MatrixResponse, band: estimate.Band) -> None:
    """Reject a coil without effect, and an acceleration that no force explains."""
    where = f"on average from {band[0]:g} to {band[1]:g} Hz: must be at least"
    moved = np.mean(found.shares, axis=0)
    for coil, name in enumerate(NAMES):
        if (most := float(moved[:, coil].max())) < estimate.SMALLEST_COHERENCE:
            raise estimate.RecordingError(
                f"axis {name}: coherence = {most:.2f} of its coil with any acceleration {where}"
                f" {estimate.SMALLEST_COHERENCE:g}; is the coil connected?"
            )
    for axis, name in enumerate(NAMES):
        if (coherence := float(np.mean(found.coherence[:, axis]))) < estimate.SMALLEST_COHERENCE:
            raise estimate.RecordingError(
                f"axis {name}: multiple coherence = {coherence:.2f} of its acceleration {where}"
                f" {estimate.SMALLEST_COHERENCE:g}; is the sensor's axis connected?"
            )


def _check_directions(found: MatrixResponse) -> None:
    """Reject a coil that moves another axis more than its own."""
    moved = found.cross_coupling
    most = moved.argmax(axis=0).tolist()
    for coil, axis in enumerate(most):
        if axis == coil:
            continue
        name, other = NAMES[coil], NAMES[axis]
        if most[axis] == coil:
            raise estimate.RecordingError(
                f"axes {name} and {other}: the coil of each moves the other axis,"
                f" {moved[axis, coil]:.0f} and {moved[coil, axis]:.0f} dB above its own, must move"
                " its own; exchange the two coils' wires, or the axes of the sensor"
            )
        raise estimate.RecordingError(
            f"axis {name}: its coil moves axis {other} the most, {moved[axis, coil]:.0f} dB above"
            f" its own, must move its own; is it mounted along {name}?"
        )


def _pushes_back(found: MatrixResponse, axis: int) -> bool:
    """Return True if an axis' own impulse response starts with negative samples.

    A force first accelerates the mass in its own direction, for any delay, mount mode and
    low-pass.
    """
    response = found.response[:, axis, axis]
    turns = np.outer(found.frequency, np.arange(round(ONSET_TIME * found.rate))) / found.rate
    basis = np.exp(-2j * np.pi * turns)
    # A ridge regression: the band does not determine all samples.
    normal = (basis.conj().T @ basis).real / len(basis) + ONSET_RIDGE * np.eye(turns.shape[1])
    impulse = np.linalg.solve(normal, (basis.conj().T @ response).real)
    size = np.abs(impulse)
    return bool(impulse[np.argmax(size > ONSET * size.max())] < 0.0)


LENGTHS = (1, 2, 4, 8, 16, 32, 64, 128, 256)
"""Allowed lengths of the impulse responses, samples. A handle that rotates in the hand at 10 Hz
needs 256 at 1 kHz."""

DECAYS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
"""Candidate time constants of the prior's standard deviation, samples."""

SCALES = 10.0 ** np.arange(-8.0, 1.1, 0.5)
"""Candidate prior variances of the second sample, relative to the data's variance. The first
samples, which are the coils' directions, are free."""

DECAYED = 6.0
"""Number of time constants after which a sample counts as zero (a four-hundredth remains)."""

EARNED = 3.0
"""Log-likelihood by which a coupling with dynamics must exceed a static one: a probability of 5 %
for the two parameters of its prior."""

LARGEST_TAP = 1.0
"""Prior standard deviation of an impulse response's second sample in the last fit, multiplied by
the largest response if that is above 1; the first sample is free (assumed)."""

LAST_TAP = 0.01
"""Prior standard deviation of the last sample over `LARGEST_TAP` in the last fit (assumed)."""

LEAST_DEVIATION = 1e-3
"""Minimum standard deviation of a line, relative to the coil's own response: the accuracy of a
coil's plant (assumed)."""

FOLLOWED = 0.2
"""Weight of the smoothed coupling's deviation in the last fit, so that the assumption above the
band does not distort the fit within the band."""

OUTSIDE = 0.3
"""Standard deviation of the coupling above the excited band from the coupling at the band's end
(assumed); relative if that coupling is above 1. The recording contains no information there, but a
controller drives the coils there too."""

BELOW, FIRST = 0.03, 3
"""Standard deviation of the coupling below the band from its mean over the first lines (assumed),
and the number of these lines."""

STEP_BELOW = 1.0
"""Spacing of the frequencies below the band, Hz."""

STEP_OUTSIDE = 5.0
"""Spacing of the frequencies above the band, Hz."""


class Coupling(NamedTuple):
    """Fitted coupling K of the axes.

    Attributes
    ----------
    taps : ndarray, shape (3, 3, length)
        Impulse responses of K at the rate of the response.
    response : ndarray, shape (n, 3, 3)
        K at the lines of the response.
    deviation : ndarray, shape (n, 3, 3)
        Standard deviation of its real and imaginary part.
    """

    taps: FloatArray
    response: ComplexArray
    deviation: FloatArray


def fit_coupling(found: MatrixResponse, own: ComplexArray, passed: ComplexArray) -> Coupling:
    """Fit the impulse responses of the nine elements of K in G = K diag(own).

    Each axis of the accelerometer has a separate mount, so K contains the ratio of two modes. This
    ratio has a long impulse response, and is poorly known where the coil's own axis hardly moves,
    but the fits of the axes determine it well. An element is divided by it before smoothing if
    that is more likely.

    The smoothing is a regression with a prior of decaying, correlated samples (TC kernel: Chen,
    Ohlsson and Ljung, Automatica 48(8), 2012), whose size and decay maximise the marginal
    likelihood, as does the variance of the data if it exceeds that of the noise. A coupling that
    differs from a static one by no more than noise is static. The impulse responses have the
    shortest of `LENGTHS` that follows the smoothed coupling within its own deviation. Above the
    band, the coupling is that at the band's end, times the ratio of the modes there, with a
    deviation of `OUTSIDE`; far below the band, the coupling is that at its start, with a deviation
    of `BELOW`.

    Parameters
    ----------
    found : MatrixResponse
    own : ndarray, shape (n, 3)
        Response that each coil would have along its own axis, at the lines of `found`.
    passed : ndarray, shape (n + m, 3, 3)
        Ratio of that response with the mount of another axis to `own`, by axis and coil, at the
        lines of `found` and at the m frequencies of `above`.
    """
    count = len(own)
    response = np.zeros_like(passed)
    deviation = np.zeros_like(found.deviation)
    for axis, coil in np.ndindex(COILS, COILS):
        ratios = [np.ones(len(passed)), passed[:, axis, coil]]
        tried = [
            (_smoothed(found, axis, coil, own[:, coil] * ratio[:count]), ratio)
            for ratio in (ratios[:1] if axis == coil else ratios)
        ]
        (_, best, spread), ratio = max(tried, key=lambda each: each[0][0])
        end = np.repeat(best[-1].real, len(ratio) - count)
        response[:, axis, coil] = np.append(best, end) * ratio
        deviation[:, axis, coil] = spread * np.abs(ratio[:count])
    known = np.maximum(deviation, LEAST_DEVIATION)
    for length in LENGTHS:
        taps = _taps(found, response, FOLLOWED * known, length)
        turns = np.outer(found.frequency, np.arange(length)) / found.rate
        modelled = np.moveaxis(taps @ np.exp(-2j * np.pi * turns).T, 2, 0)
        if np.mean(np.abs((modelled - response[:count]) / known) ** 2) < 1.0:
            break
    return Coupling(taps, response[:count], deviation)


def below(found: MatrixResponse) -> FloatArray:
    """Return the frequencies far below the band at which the coupling is assumed, Hz."""
    return np.arange(0.0, found.frequency[0] / 2, STEP_BELOW)


def above(found: MatrixResponse) -> FloatArray:
    """Return the frequencies above the band at which the coupling is assumed, Hz."""
    return np.arange(found.frequency[-1] + STEP_OUTSIDE, found.rate / 2, STEP_OUTSIDE)


def _smoothed(
    found: MatrixResponse, axis: int, coil: int, own: ComplexArray
) -> tuple[float, ComplexArray, FloatArray]:
    """Smooth an element of the coupling relative to a response `own`, shape (n,)."""
    least = LEAST_DEVIATION * np.abs(own)
    weights = np.abs(own) / np.maximum(found.deviation[:, axis, coil], least)
    measured = found.response[:, axis, coil] / own
    # Nothing is measured below the band, where a free fit would have a resonance.
    start = below(found)
    # All these frequencies share one value, which is as uncertain as the first lines.
    unsure = math.sqrt(len(start) / float(np.sum(weights[:FIRST] ** 2)))
    weights = np.append(weights, np.full(len(start), 1.0 / math.hypot(BELOW, unsure)))
    first = np.full(len(start), measured[:FIRST].real.mean(), dtype=np.complex128)
    measured = np.append(measured, first)
    lines = np.append(found.frequency, start)
    basis = np.exp(-2j * np.pi * np.outer(lines, np.arange(LENGTHS[-1])) / found.rate)
    rows, data = _stacked(basis * weights[:, np.newaxis]), _stacked(measured * weights)
    normal, vector = rows.T @ rows, rows.T @ data
    free, static = normal[0, 0], vector[0] / normal[0, 0]
    # The first sample is free, so the data are made orthogonal to it.
    power = float(data @ data) - static * float(vector[0])
    towards = normal[0, 1:] / free
    rest = normal[1:, 1:] - free * np.outer(towards, towards)
    left = vector[1:] - vector[0] * towards
    count = len(data)

    def likelihood(explained: float, gained: float) -> tuple[float, float]:
        noise = max(1.0, (power - explained) / count)
        return -(count * math.log(noise) + (power - explained) / noise + gained) / 2, noise

    best, noise = likelihood(0.0, 0.0)
    threshold, chosen = best + EARNED, None
    for root in _roots():
        size = len(root)
        values, vectors = np.linalg.eigh(root.T @ rest[:size, :size] @ root)
        values, turned = np.maximum(values, 0.0), vectors.T @ (root.T @ left[:size])
        for scale in SCALES:
            shrunk = scale / (1.0 + scale * values)
            gained = float(np.log1p(scale * values).sum())
            found_here, at = likelihood(float(shrunk @ turned**2), gained)
            if found_here > max(best, threshold):
                best, noise = found_here, at
                chosen = root @ vectors, shrunk, turned
    basis = basis[: len(own)]
    constant = basis[:, 0]
    if chosen is None:
        return best, static * constant, np.full(len(own), math.sqrt(noise / free / 2))
    directions, shrunk, turned = chosen
    size = len(directions)
    seen = (basis[:, 1 : size + 1] - np.outer(constant, towards[:size])) @ directions
    variance = noise * (1.0 / free + np.abs(seen) ** 2 @ shrunk)
    return best, static * constant + seen @ (shrunk * turned), np.sqrt(variance / 2)


@cache
def _roots() -> list[FloatArray]:
    """Return square roots of the prior's covariance matrices, without the first sample."""
    roots = []
    for decay in DECAYS:
        size = min(LENGTHS[-1] - 1, round(DECAYED * decay))
        variance = np.exp(-2.0 * np.arange(size + 1) / decay)
        # Sums of independent increments from the end have the covariance of the TC kernel.
        steps = np.append(-np.diff(variance)[:-1], variance[-2])
        roots.append(np.triu(np.ones((size, size))) * np.sqrt(steps))
    return roots


def _taps(
    found: MatrixResponse, response: ComplexArray, deviation: FloatArray, length: int
) -> FloatArray:
    """Return impulse responses of a specified length fitted to a coupling, (3, 3, length)."""
    start = below(found)
    frequency = np.concatenate([found.frequency, above(found), start])
    basis: ComplexArray = np.exp(-2j * np.pi * np.outer(frequency, np.arange(length)) / found.rate)
    prior = _prior(length)
    taps = np.zeros((COILS, COILS, length))
    for axis, coil in np.ndindex(COILS, COILS):
        target = response[:, axis, coil]
        outside = OUTSIDE * np.maximum(1.0, np.abs(target[len(deviation) :]))
        unknown = np.append(outside, np.full(len(start), BELOW))
        first = np.full(len(start), target[:FIRST].real.mean(), dtype=np.complex128)
        target = np.append(target, first)
        weights = 1.0 / np.append(deviation[:, axis, coil], unknown)
        rows = _stacked(basis * weights[:, np.newaxis])
        largest = max(1.0, float(np.abs(target).max()))
        right = rows.T @ _stacked(target * weights)
        taps[axis, coil] = np.linalg.solve(rows.T @ rows + prior / largest**2, right)
    return taps


def _prior(length: int) -> FloatArray:
    """Return the prior's inverse covariance of the samples; the first sample is free."""
    precision = np.zeros((length, length))
    if length > 1:
        index = np.arange(length - 1)
        decay = LAST_TAP ** (2.0 / (length - 1))
        covariance = LARGEST_TAP**2 * decay ** np.maximum.outer(index, index)
        precision[1:, 1:] = np.linalg.inv(covariance)
    return precision


def _stacked(values: ComplexArray) -> FloatArray:
    """Stack real parts above imaginary parts."""
    return np.concatenate([values.real, values.imag])
