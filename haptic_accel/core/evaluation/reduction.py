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

"""Comparison of reductions from three axes to one, on a recording."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, high_passed
from haptic_accel.core.evaluation.metrics import BAND_EDGES, QUIET_SHARE
from haptic_accel.core.model import FloatArray, vector
from haptic_accel.core.reduction import REDUCTIONS, PrincipalDirection

LIVE_PRINCIPAL = "principal, live"
"""Name of the row of `PrincipalDirection`; the other live reductions are also those of a whole
recording."""

SILENT = 1e-6
"""Smallest share of a band's power that counts: less is reported as -60 dB."""


@dataclass(frozen=True)
class ReductionLoss:
    """Loss by the reduction of a vibration in three axes to one signal.

    Attributes
    ----------
    name : str
    power : float
        Power of the signal over that of all three axes, above the compensation's high-pass; 1
        where nothing is lost.
    spectral_error : float
        RMS over the octaves with vibration of the level against all three axes, dB.
    """

    name: str
    power: float
    spectral_error: float


def reduction_table(acceleration: FloatArray, rate: float) -> list[ReductionLoss]:
    """Return the loss by each reduction.

    Motion of the hand and gravity are removed first, by the compensation's high-pass.

    Parameters
    ----------
    acceleration : ndarray, shape (n, 3)
        Acceleration of the tool, m/s^2.
    rate : float
        Samples per second, above 30 Hz.

    Examples
    --------
    >>> wave = np.sin(2 * np.pi * 100 * np.arange(4000) / 1000)
    >>> for row in reduction_table(np.outer(wave, [0.6, 0.0, 0.8]), 1000.0):
    ...     print(f"{row.name}: {row.power:.2f}, {row.spectral_error:.1f} dB")
    dft321: 1.00, 0.0 dB
    principal: 1.00, 0.0 dB
    sum: 1.96, 2.9 dB
    magnitude: 0.17, 27.1 dB
    axis: 0.64, 1.9 dB
    principal, live: 0.98, 0.8 dB
    """
    passed = [high_passed(each, HIGH_PASS_FREQUENCY, rate) for each in acceleration.T]
    moving = np.column_stack(passed)
    signals = {name: reduced(moving) for name, reduced in REDUCTIONS.items()}
    live = PrincipalDirection(rate)
    signals[LIVE_PRINCIPAL] = np.array([live(vector(each)) for each in moving])
    there = np.sum([_band_powers(each, rate) for each in moving.T], axis=0)
    return [_loss(name, each, there, rate) for name, each in signals.items()]


def _loss(name: str, signal: FloatArray, there: FloatArray, rate: float) -> ReductionLoss:
    """Return the loss of one reduction; `there` is the power of all axes by band."""
    kept = _band_powers(signal, rate)
    loud = there > QUIET_SHARE * there.sum()
    if not loud.any():
        return ReductionLoss(name, math.nan, math.nan)
    levels = 10 * np.log10(np.maximum(kept[loud] / there[loud], SILENT))
    error = float(np.sqrt(np.mean(levels**2)))
    return ReductionLoss(name, float(kept.sum() / there.sum()), error)


def _band_powers(signal: FloatArray, rate: float) -> FloatArray:
    """Return the power of a signal in each octave of `BAND_EDGES`."""
    power = np.abs(np.fft.rfft(signal)) ** 2
    edges = np.searchsorted(np.fft.rfftfreq(len(signal), 1 / rate), BAND_EDGES)
    return np.array([power[low:high].sum() for low, high in itertools.pairwise(edges)])
