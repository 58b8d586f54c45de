# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Online comparison of the handle's response with the plant model, by frequency band."""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.control import estimation
from haptic_accel.core.control.diagnosis import FITTING, LEAST_COHERENCE, ORDINARY, Diagnosis
from haptic_accel.core.control.feedback_design import MODEL_MEMORY
from haptic_accel.core.handle.mechanics import grid_for
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, handle_model
from haptic_accel.core.sampling import BoolArray
from haptic_accel.core.tick import FORCE, MEASURED, Trace

COMPARISON_MEMORY = 0.5
"""Time constant of the comparison, s: about eight independent windows, with a result within a
second."""

LOWEST, HIGHEST = 60.0, 450.0
"""Range of the bands, Hz. Below it the hand dominates; above it textures contain little."""

BANDS_PER_OCTAVE = 3
"""Third-octaves, as for vibration spectra; each has at least four lines of the estimate."""

HIGHEST_SHARE = 0.45
"""Upper end of the range as a fraction of the rate, if this is lower."""

LEAST_EXPECTED = 0.05
"""Minimum expected acceleration in a band for an evaluation, m/s^2 RMS: three times the noise of
the paper's accelerometer in a third-octave."""

TOLERANCE = 0.15
"""Accepted relative deviation of the response in addition to ordinary hands: errors of the
estimate, and changes of the mount between grips (assumed)."""

RAISING = 0.4
"""Time for which a band must deviate before it is reported, s; a single window is always
coherent."""

RELEASE = 0.8
"""Fraction of the tolerance below which a band fits again; the hysteresis avoids repeated
reports."""

CONTINUOUS = 15.0
"""Lower frequency limit of the force compared with dry friction, Hz: the high-pass corner."""

DEVIATES = "the handle is not as described"
"""Beginning of the warning."""


class ResponseSupervisor:
    """Monitor of the bands in which the handle's response differs from the plant model.

    The measured acceleration is compared with the model's acceleration for the applied forces.
    Their ratio is 1 if the handle fits the model. In each band its deviation from 1 is compared
    with the maximum for ordinary hands, and with the possible effect of dry friction on a small
    force. Bands with little excitation or coherence are not evaluated and keep their result.

    Parameters
    ----------
    plant : Plant
        Identified plant, with coupling and latency.
    rate : float
        Samples per second.
    trace : Trace
        Force sent at each sample, and acceleration measured at the sample before.

    Attributes
    ----------
    trace : Trace
    taps : ndarray, shape (n,)
        Impulse response of the model from force to acceleration, m/s^2 per N.
    described : bool
        True if the handle fits the model in all evaluated bands.
    """

    def __init__(self, plant: Plant, rate: float, trace: Trace) -> None:
        length = max(2, round(MODEL_MEMORY * rate))
        grid = grid_for(rate, length)
        self.taps = grid.sequence(plant.response(grid.frequency, rate))[:length]
        self.trace = trace
        self._estimator = estimation.ResponseEstimator(trace, rate, COMPARISON_MEMORY)
        self._estimator.read = self._pairs
        self._expected = np.zeros(2 * len(self._estimator.frequency) - 2)  # in the last window
        self._expected_until: int = 0  # count of the trace
        self._holding = round(estimation.EVALUATION_WINDOW * rate)
        trace.kept = max(trace.kept, 2 * self._holding + length)
        self._edges = _edges(rate)
        lines = self._estimator.frequency
        inside = [(lines >= low) & (lines < high) for low, high in self._edges]
        self._bands = np.array(inside, dtype=float).reshape(len(self._edges), len(lines))
        self._tolerated = TOLERANCE + _ordinary_deviation(plant, lines, self._bands)
        self._friction = plant.friction
        self._diagnosis = Diagnosis(plant, rate, lines)
        self._power = self._squares = 0.0
        self._per_force = np.zeros(len(lines))
        counted = lines >= CONTINUOUS
        self._per_force[counted] = 1.0 / np.abs(plant.response(lines[counted], rate)) ** 2
        self.reset()

    @property
    def ratio(self) -> ComplexArray:
        """Measured / expected response on the lines of the estimate; 1 if unknown."""
        known = self._estimator.coherence >= LEAST_COHERENCE
        return np.where(known, self._estimator.response, 1.0)

    @property
    def warning(self) -> str:
        """Deviating bands, the recommended action, and the difference; empty if there is none."""
        return ", ".join(filter(None, (self._deviating_bands(), self._diagnosis.difference)))

    def _deviating_bands(self) -> str:
        if self.described:
            return ""
        bad = np.flatnonzero(self._bad)
        low, high = self._edges[bad[0]][0], self._edges[bad[-1]][1]
        fits_above = (self._judged_once & ~self._bad)[bad[-1] + 1 :].any()
        low, high = (round(frequency, -1) for frequency in (low, high))
        where = f"between {low:g} and {high:g} Hz" if fits_above else f"above {low:g} Hz"
        return f"{DEVIATES} {where}: run identify"

    @property
    def fitting(self) -> float:
        """Time for which all evaluated bands have fitted, s.

        It starts at the last deviation or the last saturated sample.
        """
        saturated = self.trace.saturated
        return 0.0 if saturated and saturated[-1] >= self._fitted_from else self._fitting

    @property
    def left(self) -> int:
        """Number of samples until `update` has something to do."""
        return self._estimator.left

    def expected(self, length: int, force: int = FORCE, start: int = 0) -> FloatArray:
        """Return the model's acceleration at the latest samples, m/s^2, oldest first.

        The force is a signal of the trace, zero before `start`, and acts from the next sample on.
        """
        past = estimation.latest(self.trace, force, length + len(self.taps) - 1, 1, start)
        return np.convolve(past, self.taps, "valid") if past.any() else np.zeros(length)

    def _pairs(self, length: int) -> tuple[FloatArray, FloatArray]:
        # Most of a window was part of the previous one. A convolution is the longest part of this
        # work.
        new = min(length, self.trace.count - self._expected_until)
        self._expected_until = self.trace.count
        self._expected = np.concatenate([self._expected[new:], self.expected(new)])
        return self._expected.copy(), estimation.latest(self.trace, MEASURED, length)

    def update(self) -> bool:
        """Execute a part of pending computations; return True after a new result."""
        estimator = self._estimator
        done = estimator.update()
        if done and estimator.excitation.any():  # otherwise no force has driven the handle
            self._judge()
            evaluations = self._evaluations()
            # No difference is reported while a window contains a sample at which a limit acted.
            if self.trace.count >= self.trace.limited + self._holding:
                found = estimator.response, estimator.coherence, estimator.excitation
                self._diagnosis.judge(*found, estimator.interval, evaluations, self._rubbing)
        return done

    def _evaluations(self) -> float:
        """Return the effective number of evaluations in the expected power of the estimate."""
        estimator = self._estimator
        power = estimator.weight * float(estimator.excitation.sum())
        left = math.exp(-estimator.interval / COMPARISON_MEMORY)
        latest = max(0.0, power - left * self._power)
        self._power, self._squares = power, left**2 * self._squares + latest**2
        return power**2 / self._squares if self._squares else 0.0

    def reset(self) -> None:
        """Discard all samples and results, and reset the trace."""
        self.trace.reset()
        self._estimator.reset()
        self._expected_until = -len(self._expected)
        self._diagnosis.reset()
        # Power of all windows, and sum of their squared powers.
        self._power, self._squares = 0.0, 0.0
        bands = len(self._edges)
        self._over, self._under = np.zeros(bands), np.zeros(bands)
        self._bad, self._judged_once = np.zeros(bands, dtype=bool), np.zeros(bands, dtype=bool)
        self.described = True
        self._fitting, self._fitted_from = 0.0, 0

    def _judge(self) -> None:
        judged, deviation, tolerated = self._deviations()
        if not judged.any():
            return
        over = judged & (deviation > tolerated)
        interval = self._estimator.interval
        self._over = _counted(self._over, judged, over, interval)
        fits = deviation < RELEASE * tolerated
        self._under = _counted(self._under, judged, judged & fits, interval)
        self._bad = (self._bad | (self._over >= RAISING)) & (self._under < FITTING)
        self.described = not self._bad.any()
        self._judged_once |= judged
        self._fitting = 0.0 if over.any() else self.fitting + interval
        self._fitted_from = self.trace.count

    def _deviations(self) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Return the evaluated bands, their deviations, and the tolerances."""
        estimator = self._estimator
        tiny = estimation.TINY
        expected, cross = estimator.excitation, estimator.cross
        power = np.maximum(self._bands @ expected, tiny)
        off = np.abs(cross - expected) ** 2 / np.maximum(expected, tiny)
        coherent = np.abs(cross) ** 2 / np.maximum(estimator.output, tiny)
        step = float(estimator.frequency[1])
        judged = power * step >= LEAST_EXPECTED**2
        judged &= self._bands @ coherent >= LEAST_COHERENCE * power
        # A smaller force may be hidden by harmonics of friction at lower frequencies.
        judged &= self._bands @ (self._per_force * expected) * step >= self._friction**2
        force = math.sqrt(float(self._per_force @ expected) * step)
        self._rubbing = self._friction / max(force, 1e-9)  # share of dry friction
        return judged, np.sqrt(self._bands @ off / power), self._tolerated + self._rubbing


def supervise(
    plant: Plant, rate: float, force: FloatArray, acceleration: FloatArray
) -> tuple[str, float]:
    """Return the last warning for a trial, and when it first appeared; empty if none.

    Parameters
    ----------
    plant : Plant
        Plant model, with the latency.
    rate : float
        Samples per second.
    force : ndarray, shape (n,)
        Force caused by each sample, N.
    acceleration : ndarray, shape (n,)
        Handle acceleration at each sample, m/s^2.

    Returns
    -------
    warning : str
    time : float
        Time since the start, s; NaN without a warning.
    """
    supervisor = ResponseSupervisor(plant, rate, Trace())
    last, first = "", math.nan
    before = [math.nan, *acceleration.tolist()]
    for index, sent in enumerate(force.tolist()):
        supervisor.trace.push(0.0, before[index], sent, 0.0)
        if supervisor.update() and supervisor.warning:
            last = supervisor.warning
            first = index / rate if math.isnan(first) else first
    return last, first


def _counted(time: FloatArray, judged: BoolArray, holds: BoolArray, interval: float) -> FloatArray:
    """Return the duration of a condition in each evaluated band, s."""
    return np.where(judged, np.where(holds, time + interval, 0.0), time)


def _edges(rate: float) -> list[tuple[float, float]]:
    """Return the lower and upper band limits, Hz; empty at a very low rate."""
    highest = min(HIGHEST, HIGHEST_SHARE * rate)
    if highest <= LOWEST:
        return []
    bands = math.ceil(BANDS_PER_OCTAVE * math.log2(highest / LOWEST))
    lower = [LOWEST * 2 ** (band / BANDS_PER_OCTAVE) for band in range(bands)]
    return list(zip(lower, [*lower[1:], highest], strict=True))


def _ordinary_deviation(plant: Plant, lines: FloatArray, bands: FloatArray) -> FloatArray:
    """Return the largest RMS deviation of ordinary hands in each band."""
    described, *others = ORDINARY.grips(plant.handle)
    inner = slice(1, None)  # the response is zero at 0 Hz
    response = handle_model(described).response(lines[inner])
    counts = np.maximum(bands.sum(axis=1), 1.0)
    largest = np.zeros(len(bands))
    for grip in others:
        off = np.abs(handle_model(grip).response(lines[inner]) / response - 1.0) ** 2
        largest = np.maximum(largest, np.sqrt(bands[:, inner] @ off / counts))
    return largest
