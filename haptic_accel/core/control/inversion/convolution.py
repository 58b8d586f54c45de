# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""A filter of finite impulse response that takes one sample at a time."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray


class SampleWindow:
    """The latest samples of a signal, side by side.

    Parameters
    ----------
    length : int
        Number of samples; at least one.
    """

    # Filled from its end to its beginning, where the samples still needed move to the end: the
    # latest ones always lie side by side, and each is written once.

    def __init__(self, length: int) -> None:
        self._length = length
        self._past = np.zeros(2 * length)
        self._newest = length

    def push(self, value: float) -> FloatArray:
        """Take one sample; return the latest, newest first, shape (length,).

        What is returned is a view until the next one.
        """
        newest = self._newest - 1
        if newest < 0:
            kept = self._length - 1
            newest = len(self._past) - kept - 1
            self._past[newest + 1 :] = self._past[:kept]
        self._past[newest] = value
        self._newest = newest
        return self._past[newest : newest + self._length]

    def reset(self) -> None:
        """Set all samples to zero."""
        self._past[:] = 0.0


class SampleConvolution:
    """The running sum of taps times the latest samples.

    Parameters
    ----------
    taps : ndarray, shape (n,)
        Impulse response; at least one.

    Attributes
    ----------
    taps : ndarray, shape (n,)
        May be replaced by others of the same length between samples: the past stays.
    """

    def __init__(self, taps: FloatArray) -> None:
        self.taps = np.ascontiguousarray(taps, dtype=np.float64)
        self._window = SampleWindow(len(self.taps))

    def sample(self, value: float) -> float:
        """Take one input sample, return one output sample."""
        return float(self.taps.dot(self._window.push(value)))

    def reset(self) -> None:
        """Forget the past: the state of a filter that has always seen zero."""
        self._window.reset()
