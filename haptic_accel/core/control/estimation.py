# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Online estimation of a frequency response, with forgetting, and of the user's grip.

A response is estimated from input and output, the grip from force and acceleration of the handle.
"""

from __future__ import annotations

import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ComplexArray, FloatArray, HandleParameters, handle_model
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick import DESIRED, DRIVE, FORCE, MEASURED, Trace

EVALUATION_WINDOW = 0.25
"""Signal length for one evaluation, s: lines 4 Hz apart. It is five times the decay time of handle
and grip, so that little of a response lies outside its window."""

LOOKS = 4
"""Number of evaluations per window; with this overlap of Hann windows all samples have equal
weight."""

INDEPENDENCE = 0.5
"""Equivalent independent evaluations per evaluation: windows overlap by three quarters (Welch
1967)."""

FEW = 1.5
"""Number of evaluations up to which no surprise is computed."""

MOST_MISSING = 0.02
"""Maximum fraction of missing samples in a window; they repeat the previous value."""

TINY = sys.float_info.min
"""Minimum divisor: zero divided by it is zero."""

NEVER = 1 << 40
"""Number of samples that stands for "never"."""


def latest(trace: Trace, signal: int, length: int, late: int = 0, start: int = 0) -> FloatArray:
    """Return samples of a signal of a trace, oldest first; zero where there is none.

    Parameters
    ----------
    trace : Trace
    signal : int
        Row of the trace's signals.
    length : int
        Number of samples.
    late : int
        Number of newer samples that are skipped.
    start : int
        Count of the trace before which the signal counts as zero.
    """
    end = trace.stored - late
    known = min(max(0, min(trace.count - late - start, end)), length)
    samples = np.zeros(length)
    samples[length - known :] = trace.signals[signal][end - known : end]
    return samples


class Evaluation(ABC):
    """Periodic computation with a window of samples, in parts.

    It starts as soon as the window is full, unless samples are missing. Windows with a saturated
    sample are not used, as saturation hides the largest values.

    Parameters
    ----------
    trace : Trace
    length : int
        Number of samples of a window.
    hop : int
        Number of samples from one evaluation to the next, which is the maximum age of a result.
    """

    def __init__(self, trace: Trace, length: int, hop: int) -> None:
        self.trace, self._length, self._hop = trace, length, hop
        trace.kept = max(trace.kept, length + hop)
        # Gaps are counted in whole hops.
        self._span = math.ceil(length / hop) * hop
        self.restart()

    @property
    def left(self) -> int:
        """Number of samples until `update` has something to do."""
        return 1 if self._work else max(1, self._next - self.trace.count)

    def restart(self) -> None:
        """Start with the next sample."""
        self._start = self.trace.count
        self._next = self._start + self._hop
        self._work: Iterator[bool | None] | None = None

    def update(self) -> bool:
        """Execute a part of pending computations; return True after a new result."""
        count = self.trace.count
        if count >= self._next:
            end = count - (count - self._start) % self._hop
            self._next = end + self._hop
            if end - self._start >= self._length and not self._has_gaps(end):
                self._work = self._look(count - end)
        if not self._work:
            return False
        found = next(self._work, False)
        if found is not None:
            self._work = None
        return bool(found)

    def _has_gaps(self, end: int) -> bool:
        """Return True if too many measurements before a count are unknown."""
        first, trace = max(self._start, end - self._span), self.trace
        missing = sum(first <= place < end for place in trace.missing)
        return missing > MOST_MISSING * self._length or any(
            first <= place < end for place in trace.saturated
        )

    @abstractmethod
    def _look(self, late: int) -> Iterator[bool | None]:
        """Evaluate a window that ended `late` samples ago; yield None after each part.

        The last part instead yields True if there is a new result.
        """


class ResponseEstimator(Evaluation):
    """Cross-spectral estimate of output over input, by Welch's method with forgetting.

    The input may be the actuator's force, or the acceleration that a model expects for it. The
    response is then the ratio of plant to model, with a small error due to the window's length.
    While the input is zero, the response remains and the excitation decays.

    Parameters
    ----------
    trace : Trace
        Samples that `update` reads, in parts.
    rate : float
        Samples per second.
    memory : float
        Time constant of forgetting, s.
    window : float
        Signal length for one evaluation, s.
    least : float
        Minimum root mean square of the input for an evaluation; below it nothing changes.

    Attributes
    ----------
    read : callable
        Function that returns a number of the latest inputs, and of the outputs measured at the
        same ticks, oldest first. The default is force and measured acceleration. A delay between
        the two that is short compared with a window is part of the response.
    memory : float
        Time constant of forgetting, s; may be changed.
    model : ndarray, shape (n,)
        Factor of the input's spectrum, 1 at first. With a model of the response here, the estimate
        is the ratio to the model, even if the model changes between evaluations.
    weight : float
        Effective number of evaluations in the estimate, with forgetting.
    frequency : ndarray, shape (n,)
        Lines of the estimate, Hz, evenly spaced from 0 to half the rate.
    excitation : ndarray, shape (n,)
        One-sided power density of the input, its unit squared per Hz.
    output : ndarray, shape (n,)
        One-sided power density of the output, its unit squared per Hz.
    cross : ndarray, shape (n,)
        Cross-spectrum, complex: the density of the input times the response.
    estimates : int
        Number of evaluations.
    interval : float
        Time between evaluations, s.
    """

    def __init__(
        self,
        trace: Trace,
        rate: float,
        memory: float,
        window: float = EVALUATION_WINDOW,
        least: float = 0.0,
    ) -> None:
        length = _power_of_two(window * rate)
        super().__init__(trace, length, length // LOOKS)
        self.interval = self._hop / rate
        self.frequency: FloatArray = np.fft.rfftfreq(self._length, 1.0 / rate).astype(np.float64)
        shape = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(self._length) + 0.5) / self._length)
        self._shape = shape * math.sqrt(2.0 / rate / float(np.sum(shape**2)))
        self._least = least
        self.model: ComplexArray = np.ones(len(self.frequency), dtype=np.complex128)
        self.memory = memory
        self.read: Callable[[int], tuple[FloatArray, FloatArray]] = self._force_and_motion
        self.reset()

    @property
    def response(self) -> ComplexArray:
        """Output over input on the lines; zero without input."""
        return np.asarray(self.cross / np.maximum(self.excitation, TINY))

    @property
    def coherence(self) -> FloatArray:
        """Fraction of the output's power explained by the response, 0 to 1, on the lines."""
        power = np.maximum(self.excitation * self.output, TINY)
        return np.asarray(np.abs(self.cross) ** 2 / power)

    def reset(self) -> None:
        """Discard all samples."""
        lines = len(self.frequency)
        self.excitation, self.output = np.zeros(lines), np.zeros(lines)
        self.cross = np.zeros(lines, dtype=np.complex128)
        self.weight = 0.0  # sum over all windows, each new one with weight 1
        self.estimates = 0
        self.restart()

    def fade(self, factor: float) -> None:
        """Reduce the weight of all samples so far by a factor; the response remains."""
        for each in (self.excitation, self.output, self.cross):
            each *= factor

    def _look(self, late: int) -> Iterator[bool | None]:
        drive, shown = self.read(self._length)
        # Gravity is not part of the response, and would leak into the lowest lines.
        drive -= np.add.reduce(drive) / self._length
        if float(drive.dot(drive)) < self._length * self._least**2:
            return
        cause = self.model * np.fft.rfft(drive * self._shape)
        yield None
        effect = np.fft.rfft((shown - np.add.reduce(shown) / self._length) * self._shape)
        self._compare(cause, effect)
        yield None
        weight = math.exp(-self.interval / self.memory) * self.weight + 1.0
        share = 1.0 / weight
        excitation = self.excitation + share * (np.abs(cause) ** 2 - self.excitation)
        output = self.output + share * (np.abs(effect) ** 2 - self.output)
        cross = self.cross + share * (cause.conj() * effect - self.cross)
        yield None
        # All in one step, so that the values are consistent.
        self.weight, self.excitation, self.output, self.cross = weight, excitation, output, cross
        self.estimates += 1
        yield True

    def _force_and_motion(self, length: int) -> tuple[FloatArray, FloatArray]:
        return latest(self.trace, FORCE, length), latest(self.trace, MEASURED, length)

    def _compare(self, cause: ComplexArray, effect: ComplexArray) -> None:
        """Compare the spectra of a window with the estimate from the windows before."""


class ChangeEstimator(ResponseEstimator):
    """Estimate that detects a change of the response.

    Attributes
    ----------
    surprise : float
        Power of the output that the estimate did not explain in the latest windows, relative to
        the power that its own coherence predicts; far above 1 after a change of the response.
    """

    def reset(self) -> None:
        """Discard all samples."""
        super().reset()
        self.surprise = 1.0

    def _compare(self, cause: ComplexArray, effect: ComplexArray) -> None:
        if self.weight > FEW:
            self.surprise += (self._surprise(cause, effect) - self.surprise) / 2.0

    def _surprise(self, cause: ComplexArray, effect: ComplexArray) -> float:
        """Return the unexplained power of a window relative to the predicted one."""
        left = np.abs(effect - self.response * cause) ** 2
        independent = max(1.0, INDEPENDENCE * self.weight) + 0.5
        # A fit to few windows leaves too little of them unexplained, and too much of the next.
        predicted = float(np.sum(self.output * (1.0 - self.coherence)))
        predicted *= (independent + 1.0) / (independent - 1.0)
        return float(left.sum()) / max(predicted, TINY)


class AutocorrelationEstimator(Evaluation):
    """Autocorrelation of a signal, up to a lag, with forgetting.

    The signal is weighted by an exponential that decays into the past, and its autocorrelation by
    Bartlett's lag window, so that the spectrum is nowhere negative (Blackman and Tukey, Bell
    System Tech. J. 37, 1958). At lags far below the longest the result is nearly exact.

    Parameters
    ----------
    trace : Trace
        Samples that `update` reads, in parts: those of `drive`, while `desired` is large enough.
    rate : float
        Samples per second.
    memory : float
        Time constant of forgetting, s.
    interval : float
        Time between evaluations, s.
    longest : float
        Longest lag, s.
    least : float
        Minimum root mean square of `desired` for an evaluation; below it nothing changes.

    Attributes
    ----------
    sequence : ndarray, shape (n,)
        Autocorrelation at the lags 0 to n - 1, summed over the samples; the unit of the signal
        squared.
    weight : float
        Effective number of evaluations in the estimate, with forgetting.
    """

    def __init__(
        self,
        trace: Trace,
        rate: float,
        memory: float,
        interval: float,
        longest: float,
        least: float,
    ) -> None:
        hop = round(interval * rate)
        super().__init__(trace, hop, hop)
        self._lags = _power_of_two(longest * rate)
        trace.kept = max(trace.kept, self._lags + 2 * hop)
        self._least = self._hop * least**2
        self._kept = math.exp(-self._hop / rate / memory)
        # The weight of a product is the geometric mean of those of its two samples.
        lag = np.arange(self._lags)
        self._faded = self._kept ** (lag / (2 * self._hop)) * (1.0 - lag / self._lags)
        self.reset()

    def reset(self) -> None:
        """Discard all samples."""
        self.sequence = np.zeros(self._lags)
        self.weight = 0.0
        self.restart()

    def _has_gaps(self, end: int) -> bool:
        return False  # no measurement is needed

    def _look(self, late: int) -> Iterator[bool | None]:
        trace = self.trace
        level = latest(trace, DESIRED, self._hop, late)
        if float(level.dot(level)) < self._least:
            return
        samples = latest(trace, DRIVE, self._lags + self._hop, late, self._start)[::-1]
        newest = np.fft.rfft(samples[: self._hop], len(samples))
        yield None
        spectrum = np.fft.rfft(samples)
        yield None
        products = np.fft.irfft(newest.conj() * spectrum, len(samples))[: self._lags]
        yield None
        self.sequence = self._kept * self.sequence + self._faded * products
        self.weight = self._kept * self.weight + 1.0
        yield True


def _power_of_two(samples: float) -> int:
    """Return the nearest power of two for fast transforms, at least 16."""
    return 1 << max(4, round(math.log2(samples)))


GRIP = {"m_h": "kg", "b_u": "N s/m", "k_u": "N/m"}
"""Parameters of the grip and their units, in the order of all arrays."""

HOP = 0.016
"""Time between evaluations, s: enough for several independent values of a texture."""

LENGTH = 0.192
"""Length of the filters' impulse responses, s; they have decayed by then."""

AHEAD = 0.012
"""Length of the filter's non-causal part, s. It delays the estimate, and is needed for the upper
band edge."""

THINNED_RATE = 1000.0
"""Maximum rate for evaluating the equation, Hz; faster signals are decimated."""

LOWEST, HIGHEST = 15.0, 250.0
"""Frequency band of the estimate, Hz: above the hand's own motion, below the mount's mode."""

STEEPNESS = 4
"""Order of the lower band edge: two for the integrations, two for the hand's own motion."""

SMALLEST = (0.35, 0.1, 0.05)
LARGEST_FACTORS = (3.5, 8.0, 9.0)
"""Upper bounds of the estimate as factors of the assumed m_h, b_u and k_u; wider than hands
vary."""

INSIDE = 0.95
"""Fraction of a bound below which a parameter no longer counts as at the bound."""

PERSISTENT = 20
"""Number of successive evaluations at a bound after which it is reported."""

LEAST_FORCE = 0.02
"""Minimum root mean square of the actuator's force within the band for an update, N."""

PULL = 16.0
"""Ratio of excitation to noise at which the equation and the assumed grip have equal weight. A
spectral line determines two of three parameters, and the third would be determined by noise alone.
With half this ratio, weak lines change the grip; with four times this ratio, hands that differ
much from the assumed one are not found."""

ARM = 40.0
"""Frequency below which the motion with the arm exceeds the sensor's noise, Hz; its level is
inversely proportional to frequency."""

SURPRISE = 3.0
"""Ratio above which the past is discarded: squared error of the latest hop with the present grip
over the smallest error with any grip. Three parameters fitted to some ten independent values
reduce the smallest error by a third, and a ratio of a few can occur by chance."""

NEGLIGIBLE = 3e-4
"""Squared error, relative to the squared force, that always counts as noise: 2 % of the force."""

FEWEST = 6
"""Minimum number of evaluations before the first change of the grip; they cover the onset of the
first contact."""

NOTICEABLE = 0.01
"""Minimum relative change of a parameter for a change of the grip, as new taps take computing
time."""


Factors = list[float]
"""m_h, b_u and k_u relative to the assumed values."""


@dataclass(frozen=True)
class AdaptationParameters(Checked):
    """Parameters of the grip estimator."""

    memory: float = parameter(
        0.4, "time constant of the forgetting, while the handle is excited", "s", 0.05, 100.0
    )


class GripEstimator(Evaluation):
    """Recursive least squares for m_h, b_u and k_u, hop by hop.

    Eq. (2) of the paper is linear in them. Eq. (1) describes the actuator with known mass, spring
    and bearing. The path between command and sample (hold, delay, mount, low-pass) is the ratio
    P/H of the assumed plant: m_a s^2/A F' - m_a (b_s s + k_s)/A A_h = (m_h + b_u/s + k_u/s^2) A_h,
    A = m_a s^2 + b_s s + k_s, F' = (P/H) F. All terms pass the same band-pass, in which
    integrations are harmless, and are compared at its output.

    Each hop is weighted by the inverse of its smallest error with any grip. A hop in which a
    loaded grip suddenly changes fits no grip, and thus has little weight. If the error with the
    present grip is much larger than the smallest, the hand has changed, and the past is discarded.
    Where noise of this size could explain the estimate as well, the estimate is pulled towards the
    assumed grip.

    `update` returns True when the grip has changed.

    Parameters
    ----------
    trace : Trace
        Force, and acceleration measured at the same tick.
    plant : Plant
        Assumed plant; the estimate starts with its grip.
    rate : float
        Samples per second.
    parameters : AdaptationParameters

    Attributes
    ----------
    grip : ndarray, shape (3,)
        Estimated m_h, b_u and k_u: kg, N s/m, N/m.
    estimates : int
        Number of evaluations of an excited handle.
    """

    def __init__(
        self, trace: Trace, plant: Plant, rate: float, parameters: AdaptationParameters
    ) -> None:
        handle = plant.handle
        self._assumed = np.array([getattr(handle, name) for name in GRIP])
        thinning = max(1, math.floor(rate / THINNED_RATE))
        rows = max(8, round(HOP * rate / thinning))
        kernels = _kernels(plant, rate)
        kernels[:3] *= self._assumed[:, np.newaxis]
        filters = np.stack([_sliding(kernel, rows, thinning) for kernel in kernels])
        super().__init__(trace, filters.shape[-1], rows * thinning)
        self._of_acceleration = filters[:4].reshape(-1, self._length)
        self._of_force = filters[4]
        # Moments of the noise in each term, and in the deviations from the assumed grip.
        lines = np.fft.rfftfreq(kernels.shape[1], 1.0 / rate)[1:]
        noise = np.fft.rfft(kernels[:4])[:, 1:] * np.hypot(1.0, ARM / lines)
        deviating = np.vstack([noise[:3], noise[:3].sum(axis=0)])
        self._noise, self._deviating = ((each @ each.conj().T).real for each in (noise, deviating))
        self._kept = math.exp(-self._hop / rate / parameters.memory)
        self._least_energy = rows * LEAST_FORCE**2
        self.reset()

    @property
    def at_end(self) -> dict[str, str]:
        """Parameters that remain at a bound of their range, each with "upper" or "lower"."""
        return {
            name: "upper" if count > 0 else "lower"
            for name, count in zip(GRIP, self._beyond, strict=True)
            if abs(count) >= PERSISTENT
        }

    def reset(self) -> None:
        """Return to the assumed grip."""
        self.grip = self._assumed.copy()
        self._present: Factors = [1.0, 1.0, 1.0]
        self._moments = np.zeros((4, 4))
        self._energy = 0.0
        self._beyond = [0, 0, 0]  # evaluations in a row at the upper bound; negative: lower
        self.estimates = 0
        self.restart()

    def _look(self, late: int) -> Iterator[bool | None]:
        # Newest sample first, as in the filters.
        force, motion = (
            latest(self.trace, each, self._length)[::-1].copy() for each in (FORCE, MEASURED)
        )
        driving = self._of_force @ force
        terms = (self._of_acceleration @ motion).reshape(4, -1)
        yield None
        energy = float(driving.dot(driving))
        if energy > self._least_energy:
            terms[3] += driving
            yield self._learn(terms @ terms.T, energy)

    def _learn(self, moments: FloatArray, energy: float) -> bool:
        """Add the second moments and energy of a hop; return True if the grip changed.

        The terms are those of m_h, b_u and k_u at their assumed values, and the measured sum.
        """
        self.estimates += 1
        self._energy = self._kept * self._energy + (1.0 - self._kept) * energy
        error = _error(moments, self._present)
        pull = self._deviating / _error(self._noise, self._present)
        negligible = NEGLIGIBLE * max(energy, self._energy)
        noise = _error(moments, _solution(moments + negligible * pull)) + negligible
        trust = min(1.0, SURPRISE * noise / error) if error > 0.0 else 1.0
        self._moments = self._kept * trust**2 * self._moments + moments / noise + PULL * pull
        found = self._within_bounds(_solution(self._moments))
        moved = max(abs(1.0 - old / new) for old, new in zip(self._present, found, strict=True))
        if self.estimates < FEWEST or moved < NOTICEABLE:
            return False
        self._present = found
        self.grip = self._assumed * found
        return True

    def _within_bounds(self, factors: Factors) -> Factors:
        """Return the nearest factors within bounds, and count evaluations beyond each bound."""
        found = []
        limits = zip(factors, SMALLEST, LARGEST_FACTORS, strict=True)
        for index, (factor, low, high) in enumerate(limits):
            count = self._beyond[index]
            if factor >= (INSIDE * high if count >= PERSISTENT else high):
                self._beyond[index] = max(0, count) + 1
            elif factor <= (low / INSIDE if count <= -PERSISTENT else low):
                self._beyond[index] = min(0, count) - 1
            else:
                self._beyond[index] = 0
            found.append(min(max(factor, low), high))
        return found


def _error(moments: FloatArray, factors: Factors) -> float:
    """Return the squared error of the equation, N^2."""
    weights = np.array([*factors, -1.0])
    return max(0.0, float(weights.dot(moments.dot(weights))))


def _solution(moments: FloatArray) -> Factors:
    """Return the factors with the smallest error."""
    (a, b, c, x), (_, d, e, y), (_, _, f, z), _ = moments.tolist()
    # Cramer's rule takes a tenth of the time of numpy.linalg for three unknowns.
    aa, ab, ac = d * f - e * e, c * e - b * f, b * e - c * d
    bb, bc, cc = a * f - c * c, b * c - a * e, a * d - b * b
    rows = ((aa, ab, ac), (ab, bb, bc), (ac, bc, cc))
    determinant = a * aa + b * ab + c * ac
    return [(p * x + q * y + r * z) / determinant for p, q, r in rows]


def _sliding(kernel: FloatArray, rows: int, step: int) -> FloatArray:
    """Return a filter matrix for a window: each row is the kernel, shifted by one more step."""
    length = len(kernel)
    filters = np.zeros((rows, length + (rows - 1) * step))
    for row in range(rows):
        filters[row, row * step : row * step + length] = kernel
    return filters


def _kernels(plant: Plant, rate: float) -> FloatArray:
    """Return the impulse responses of the regression's terms, newest sample first.

    Returns
    -------
    ndarray, shape (5, n)
        Impulse responses for m_h, b_u and k_u, for the acceleration in eq. (1), and for the force.
    """
    length, ahead = round(LENGTH * rate), max(1, round(AHEAD * rate))
    fine = 16 * length
    frequency: FloatArray = np.fft.rfftfreq(fine, 1.0 / rate)[1:].astype(np.float64)
    s = 2j * np.pi * frequency
    # The lower band edge is causal and decays within a few hops; the upper one has zero phase.
    lower = (s / (s + 2 * np.pi * LOWEST)) ** STEEPNESS
    band = lower / (1.0 + (frequency / min(HIGHEST, 0.4 * rate)) ** 8)
    handle: HandleParameters = plant.handle
    bearing = handle.b_s * s + handle.k_s
    actuator = handle.m_a * s**2 + bearing
    chain = plant.response(frequency, rate) / handle_model(handle).response(frequency)
    responses = np.zeros((5, len(frequency) + 1), dtype=np.complex128)
    responses[:, 1:] = band * np.stack(
        [
            np.ones_like(s),
            1.0 / s,
            1.0 / s**2,
            -handle.m_a * bearing / actuator,
            chain * handle.m_a * s**2 / actuator,
        ]
    )
    kernels = np.roll(np.fft.irfft(responses, fine), ahead, axis=1)[:, :length]
    # Fade out at both ends, where the response is small.
    kernels *= np.minimum(1.0, (np.arange(length) + 1) / (ahead / 2))
    kernels *= np.minimum(1.0, np.arange(length, 0, -1) / (length / 4))
    # Gravity is not part of the response.
    return np.asarray(kernels - kernels.mean(axis=1, keepdims=True))
