# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Online estimation of a response from its input and output, with forgetting."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from haptic_accel.core.control.paired_window import PairedWindow
from haptic_accel.core.model import ComplexArray, FloatArray

WINDOW = 0.25
"""Length of signal for one evaluation, s: lines 4 Hz apart, and five times the decay of handle and
grip, so that little of a response ends outside its window."""

LOOKS = 4
"""Number of evaluations per window; Hann windows that overlap so far lose no sample's weight."""


class ResponseEstimator:
    """Cross-spectral estimate of output over input, by Welch's method with forgetting.

    The input may be the actuator's force, or the acceleration that a model expects of it: the
    response is then the ratio of plant to model, in which little is lost by the window's length.
    While the input is zero the response stays what it was, and the excitation decays.

    A sample only stores two values; all else is done in pieces by `step`.

    Parameters
    ----------
    rate : float
        Samples per second.
    memory : float
        Time constant of forgetting, s.
    window : float
        Length of signal for one evaluation, s.
    least : float
        Minimum root mean square of the input for an evaluation; below it nothing is learnt.

    Attributes
    ----------
    model : ndarray, shape (n,)
        Factor of the input's spectrum, 1 at first: with a model of the response the estimate is
        the ratio to it, even where the model changes from one evaluation to the next.
    weight : float
        Number of evaluations in the estimate, older ones forgotten.
    frequency : ndarray, shape (n,)
        Lines of the estimate, Hz, evenly spaced from 0 to half the rate.
    excitation : ndarray, shape (n,)
        One-sided power density of the input, its unit squared per Hz.
    output : ndarray, shape (n,)
        That of the output.
    cross : ndarray, shape (n,)
        Their cross-spectrum, complex: the density of the input times the response.
    looks : int
        Number of evaluations.
    interval : float
        Time between two of them, s.
    """

    def __init__(
        self, rate: float, memory: float, window: float = WINDOW, least: float = 0.0
    ) -> None:
        self._length = 1 << max(4, round(math.log2(window * rate)))
        self._hop = self._length // LOOKS
        self.interval = self._hop / rate
        self.frequency: FloatArray = np.fft.rfftfreq(self._length, 1.0 / rate).astype(np.float64)
        shape = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(self._length) + 0.5) / self._length)
        self._shape = shape * math.sqrt(2.0 / rate / float(np.sum(shape**2)))
        self._least = least
        self.model: ComplexArray = np.ones(len(self.frequency), dtype=np.complex128)
        self._kept = math.exp(-self.interval / memory)
        self._window = PairedWindow(self._length, self._hop)
        self._work: Iterator[bool] = iter(())
        self.reset()

    @property
    def response(self) -> ComplexArray:
        """Output over input on the lines; zero where there never was an input."""
        return np.asarray(self.cross / np.maximum(self.excitation, np.finfo(float).tiny))

    @property
    def coherence(self) -> FloatArray:
        """Fraction of the output's power that the response explains, 0 to 1, on the lines."""
        power = np.maximum(self.excitation * self.output, np.finfo(float).tiny)
        return np.asarray(np.abs(self.cross) ** 2 / power)

    def sample(self, force: float, acceleration: float) -> None:
        """Store one sample of input and output (NaN where unknown).

        Parameters
        ----------
        force : float
            Input: a force, N, or an expected acceleration, m/s^2; finite.
        acceleration : float
            Output, m/s^2: what is measured at the same tick. A delay between the two, small
            against `WINDOW`, is a part of the response.
        """
        if self._window.push(force, acceleration):
            self._work = self._look()

    def step(self) -> bool:
        """Do a piece of the pending work; return True when there is a new estimate."""
        return next(self._work, False)

    def reset(self) -> None:
        """Forget all samples."""
        lines = len(self.frequency)
        self.excitation, self.output = np.zeros(lines), np.zeros(lines)
        self.cross = np.zeros(lines, dtype=np.complex128)
        self.weight = 0.0  # of all windows, each new one counting 1
        self.looks = 0
        self._work = iter(())
        self._window.reset()

    def _look(self) -> Iterator[bool]:
        """Evaluate the latest window; yield between pieces, at last True."""
        given, shown = (samples[::-1].copy() for samples in self._window.latest())
        # Gravity is no part of the response, and would leak into the lowest lines.
        given -= given.mean()
        if float(given.dot(given)) < self._length * self._least**2:
            return
        cause = self.model * np.fft.rfft(given * self._shape)
        yield False
        effect = np.fft.rfft((shown - shown.mean()) * self._shape)
        yield False
        weight = self._kept * self.weight + 1.0
        share = 1.0 / weight
        excitation = self.excitation + share * (np.abs(cause) ** 2 - self.excitation)
        output = self.output + share * (np.abs(effect) ** 2 - self.output)
        cross = self.cross + share * (cause.conj() * effect - self.cross)
        yield False
        # All at once, in a turn that is left for those who wait for it.
        self.weight, self.excitation, self.output, self.cross = weight, excitation, output, cross
        self.looks += 1
        yield True
