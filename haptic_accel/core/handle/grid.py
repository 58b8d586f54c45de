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

"""Frequency grid for the inversion of a plant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from haptic_accel.core.model import ComplexArray, FloatArray

FINEST_STEP = 0.2
"""Frequency spacing of a grid, Hz: a fifth of the lowest corner in a filter."""


@dataclass(frozen=True)
class Grid:
    """Frequencies between the lines of a discrete Fourier transform, without 0 Hz.

    Handle and high-pass have zeros at 0 Hz, which would cause a division by zero.

    Attributes
    ----------
    rate : float
        Samples per second.
    points : int
        Number of frequencies, evenly spaced up to half the rate.
    """

    rate: float
    points: int

    @property
    def frequency(self) -> FloatArray:
        """Frequencies, Hz, shape (points,)."""
        return np.asarray((np.arange(self.points) + 0.5) * self.spacing, dtype=np.float64)

    @property
    def spacing(self) -> float:
        """Distance between two frequencies, Hz."""
        return self.rate / (2 * self.points)

    def delay(self, samples: float) -> ComplexArray:
        """Return the response of a delay."""
        turns = self.frequency / self.rate * samples
        return np.asarray(np.exp(-2j * np.pi * turns))

    def spectrum(self, sequence: FloatArray) -> ComplexArray:
        """Return the Fourier transform of a real sequence that starts at time zero.

        Parameters
        ----------
        sequence : ndarray, shape (n,)
            Real sequence; n at most twice `points`.
        """
        shift = np.exp(-1j * np.pi * np.arange(len(sequence)) / (2 * self.points))
        return np.asarray(np.fft.fft(sequence * shift, 2 * self.points)[: self.points])

    def sequence(self, spectrum: ComplexArray | FloatArray) -> FloatArray:
        """Return the real sequence of a Fourier transform, shape (2 points,).

        It is antiperiodic: its second half, with opposite sign, contains the times before zero.
        """
        both = np.concatenate([spectrum, np.zeros(self.points)])
        shift = np.exp(1j * np.pi * np.arange(2 * self.points) / (2 * self.points))
        return np.asarray(2.0 * (np.fft.ifft(both) * shift).real)


def grid_for(rate: float, taps: int = 0, step: float = FINEST_STEP) -> Grid:
    """Return a grid with a step in Hz or finer, long enough for a filter with a number of taps."""
    needed = max(rate / (2 * step), 4 * taps)
    return Grid(rate, 1 << int(np.ceil(np.log2(needed))))
