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

"""Finite impulse response filter, processed sample by sample."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import dot


class SampleWindow:
    """Latest samples of a signal in contiguous memory.

    Parameters
    ----------
    length : int
        Number of samples; at least one.
    """

    # Filled from the end to the beginning, where the samples still needed move to the end. The
    # latest samples are thus always contiguous, and each is written once.

    def __init__(self, length: int) -> None:
        self._length = length
        self._past = np.zeros(2 * length)
        self._newest = length

    def push(self, value: float) -> FloatArray:
        """Add a sample; return the latest ones, newest first, shape (length,).

        The result is a view, valid until the next call.
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
    """Running sum of taps times the latest samples.

    Parameters
    ----------
    taps : ndarray, shape (n,)
        Impulse response; at least one.

    Attributes
    ----------
    taps : ndarray, shape (n,)
        May be replaced between samples by others of the same length; the past remains.
    """

    def __init__(self, taps: FloatArray) -> None:
        self.taps = np.ascontiguousarray(taps, dtype=np.float64)
        self._window = SampleWindow(len(self.taps))
        self._products = np.empty(len(self.taps))

    def process(self, value: float) -> float:
        """Filter one sample."""
        return dot(self.taps, self._window.push(value), 0, self._products)

    def reset(self) -> None:
        """Clear the state, as for zero past input."""
        self._window.reset()
