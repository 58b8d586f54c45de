# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Online estimation of a frequency response from input and output, with forgetting."""

from __future__ import annotations

import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator

import numpy as np

from haptic_accel.core.model import ComplexArray, FloatArray
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
