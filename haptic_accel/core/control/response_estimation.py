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

"""Online estimation of a frequency response from input and output, with forgetting."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator

import numpy as np

from haptic_accel.core.control.inversion.convolution import SampleWindow
from haptic_accel.core.model import ComplexArray, FloatArray

EVALUATION_WINDOW = 0.25
"""Signal length for one evaluation, s: lines 4 Hz apart. It is five times the decay time of handle
and grip, so that little of a response lies outside its window."""

LOOKS = 4
"""Number of evaluations per window; with this overlap of Hann windows all samples have equal
weight."""

INDEPENDENCE = 0.5
"""Independent evaluations per evaluation: windows overlap by three quarters (Welch 1967)."""

FEW = 1.5
"""Number of evaluations up to which nothing is a surprise."""


class ResponseEstimator:
    """Cross-spectral estimate of output over input, by Welch's method with forgetting.

    The input may be the actuator's force, or the acceleration that a model expects for it. The
    response is then the ratio of plant to model, with a small error due to the window's length.
    While the input is zero, the response remains and the excitation decays.

    `observe` only stores two values; `update` does all computations in parts.

    Parameters
    ----------
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
    surprise : float
        Power of the output that the estimate did not explain in the latest windows, relative to
        the one that its own coherence predicts; far above 1 after a change of the response.
    interval : float
        Time between evaluations, s.
    """

    def __init__(
        self, rate: float, memory: float, window: float = EVALUATION_WINDOW, least: float = 0.0
    ) -> None:
        self._length = _power_of_two(window * rate)
        self._hop = self._length // LOOKS
        self.interval = self._hop / rate
        self.frequency: FloatArray = np.fft.rfftfreq(self._length, 1.0 / rate).astype(np.float64)
        shape = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(self._length) + 0.5) / self._length)
        self._shape = shape * math.sqrt(2.0 / rate / float(np.sum(shape**2)))
        self._least = least
        self.model: ComplexArray = np.ones(len(self.frequency), dtype=np.complex128)
        self.memory = memory
        self._window = PairedWindow(self._length, self._hop)
        self._work: Iterator[bool] = iter(())
        self.reset()

    @property
    def response(self) -> ComplexArray:
        """Output over input on the lines; zero without input."""
        return np.asarray(self.cross / np.maximum(self.excitation, np.finfo(float).tiny))

    @property
    def coherence(self) -> FloatArray:
        """Fraction of the output's power explained by the response, 0 to 1, on the lines."""
        power = np.maximum(self.excitation * self.output, np.finfo(float).tiny)
        return np.asarray(np.abs(self.cross) ** 2 / power)

    def observe(self, force: float, acceleration: float) -> None:
        """Store one sample of input and output (NaN if unknown).

        Parameters
        ----------
        force : float
            Input: a force, N, or an expected acceleration, m/s^2; finite.
        acceleration : float
            Output measured at the same tick, m/s^2. A delay between the two that is short compared
            with `EVALUATION_WINDOW` is part of the response.
        """
        if self._window.push(force, acceleration):
            self._work = self._look()

    def update(self) -> bool:
        """Execute a part of pending computations; return True after a new estimate."""
        return next(self._work, False)

    def reset(self) -> None:
        """Forget all samples."""
        lines = len(self.frequency)
        self.excitation, self.output = np.zeros(lines), np.zeros(lines)
        self.cross = np.zeros(lines, dtype=np.complex128)
        self.weight = 0.0  # sum over all windows, each new one with weight 1
        self.surprise = 1.0
        self.estimates = 0
        self._work = iter(())
        self._window.reset()

    def _look(self) -> Iterator[bool]:
        """Evaluate the latest window in parts; yield after each part, finally True."""
        given, shown = (samples[::-1].copy() for samples in self._window.latest())
        # Gravity is not part of the response, and would leak into the lowest lines.
        given -= given.mean()
        if float(given.dot(given)) < self._length * self._least**2:
            return
        cause = self.model * np.fft.rfft(given * self._shape)
        yield False
        effect = np.fft.rfft((shown - shown.mean()) * self._shape)
        if self.weight > FEW:
            self.surprise += (self._surprise(cause, effect) - self.surprise) / 2.0
        yield False
        weight = math.exp(-self.interval / self.memory) * self.weight + 1.0
        share = 1.0 / weight
        excitation = self.excitation + share * (np.abs(cause) ** 2 - self.excitation)
        output = self.output + share * (np.abs(effect) ** 2 - self.output)
        cross = self.cross + share * (cause.conj() * effect - self.cross)
        yield False
        # All in one step, so that the values are consistent.
        self.weight, self.excitation, self.output, self.cross = weight, excitation, output, cross
        self.estimates += 1
        yield True

    def _surprise(self, cause: ComplexArray, effect: ComplexArray) -> float:
        """Return the unexplained power of a window relative to the predicted one."""
        left = np.abs(effect - self.response * cause) ** 2
        independent = max(1.0, INDEPENDENCE * self.weight) + 0.5
        # A fit to few windows explains too much of them, and too little of the next.
        predicted = float(np.sum(self.output * (1.0 - self.coherence)))
        predicted *= (independent + 1.0) / (independent - 1.0)
        return float(left.sum()) / max(predicted, np.finfo(float).tiny)


class AutocorrelationEstimator:
    """Autocorrelation of a signal, up to a lag, with forgetting.

    The signal is weighted by an exponential that falls into the past, and its autocorrelation by
    Bartlett's lag window, so that the spectrum is nowhere negative (Blackman and Tukey, Bell
    System Tech. J. 37, 1958). At lags far below the longest the result is nearly exact.

    `observe` only stores a sample; `update` does all computations in parts.

    Parameters
    ----------
    rate : float
        Samples per second.
    memory : float
        Time constant of forgetting, s.
    interval : float
        Time between evaluations, s.
    longest : float
        Longest lag, s.
    least : float
        Minimum root mean square of the level for an evaluation; below it nothing changes.

    Attributes
    ----------
    sequence : ndarray, shape (n,)
        Autocorrelation at the lags 0 to n - 1, summed over the samples; the unit of the signal
        squared.
    weight : float
        Effective number of evaluations in the estimate, with forgetting.
    """

    def __init__(
        self, rate: float, memory: float, interval: float, longest: float, least: float
    ) -> None:
        self._lags = _power_of_two(longest * rate)
        self._hop = round(interval * rate)
        self._least = self._hop * least**2
        self._kept = math.exp(-self._hop / rate / memory)
        # The weight of a product is the geometric mean of those of its two samples.
        lag = np.arange(self._lags)
        self._faded = self._kept ** (lag / (2 * self._hop)) * (1.0 - lag / self._lags)
        self._window = SampleWindow(self._lags + self._hop)
        self._count, self._power = 0, 0.0
        self._work: Iterator[bool] = iter(())
        self.reset()

    def observe(self, level: float, value: float) -> None:
        """Store one sample.

        Parameters
        ----------
        level : float
            Signal that shows whether there is something to learn.
        value : float
            Signal whose autocorrelation is estimated.
        """
        latest = self._window.push(value)
        self._power += level * level
        self._count += 1
        if self._count == self._hop:
            if self._power >= self._least:
                self._work = self._look(latest.copy())
            self._count, self._power = 0, 0.0

    def update(self) -> bool:
        """Execute a part of pending computations; return True after a new estimate."""
        return next(self._work, False)

    def reset(self) -> None:
        """Forget all samples."""
        self.sequence = np.zeros(self._lags)
        self.weight = 0.0
        self._count, self._power = 0, 0.0
        self._work = iter(())
        self._window.reset()

    def _look(self, latest: FloatArray) -> Iterator[bool]:
        """Add the products of the newest samples with all before; finally yield True."""
        newest = np.fft.rfft(latest[: self._hop], len(latest))
        yield False
        spectrum = np.fft.rfft(latest)
        yield False
        products = np.fft.irfft(newest.conj() * spectrum, len(latest))[: self._lags]
        yield False
        self.sequence = self._kept * self.sequence + self._faded * products
        self.weight = self._kept * self.weight + 1.0
        yield True


def _power_of_two(samples: float) -> int:
    """Return the nearest length for fast transforms, at least 16."""
    return 1 << max(4, round(math.log2(samples)))


MOST_MISSING = 0.02
"""Maximum fraction of missing samples in a window; they repeat the previous value."""


class PairedWindow:
    """Buffer of cause and effect that reports when a window can be evaluated.

    Parameters
    ----------
    length : int
        Number of samples.
    hop : int
        Number of samples from one evaluation to the next.
    """

    def __init__(self, length: int, hop: int) -> None:
        self._length, self._hop = length, hop
        # Filled from its end to its beginning, as in `SampleWindow`.
        self._cause, self._effect = np.zeros(2 * length), np.zeros(2 * length)
        self._newest = length
        # Missing samples in the present part of the window, and in the parts before.
        self._missing: deque[int] = deque(maxlen=math.ceil(length / hop))
        self.reset()

    def push(self, cause: float, effect: float) -> bool:
        """Add a sample pair; return True if the window is due and complete enough.

        Parameters
        ----------
        cause : float
            Finite.
        effect : float
            NaN if missing, infinite if the sensor was saturated.
        """
        newest = self._newest - 1
        if newest < 0:
            newest = self._moved()
        if not math.isfinite(effect):
            # A saturated sample hides the largest values: its window is not used.
            self._missing[-1] += 1 if math.isnan(effect) else self._length
            effect = self._effect[newest + 1]
        self._newest = newest
        self._cause[newest] = cause
        self._effect[newest] = effect
        self._samples += 1
        if self._samples % self._hop:
            return False
        few = sum(self._missing) <= MOST_MISSING * self._length
        self._missing.append(0)
        return self._samples >= self._length and few

    def latest(self) -> tuple[FloatArray, FloatArray]:
        """Return cause and effect, newest first; views until the next sample."""
        latest = slice(self._newest, self._newest + self._length)
        return self._cause[latest], self._effect[latest]

    def reset(self) -> None:
        """Discard all samples."""
        self._samples = 0
        self._missing.clear()
        self._missing.append(0)
        self._cause[:] = self._effect[:] = 0.0
        self._newest = self._length

    def _moved(self) -> int:
        """Move the samples still needed to the end; return the index before them."""
        kept = self._length - 1
        index = len(self._cause) - kept
        for samples in (self._cause, self._effect):
            samples[index:] = samples[:kept]
        return index - 1
