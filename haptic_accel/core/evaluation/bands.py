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

"""Error of the handle's acceleration by frequency band."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY
from haptic_accel.core.evaluation.metrics import spectra
from haptic_accel.core.model import FloatArray

BAND_EDGES = (15.0, 30.0, 60.0, 125.0, 250.0, 500.0, 1000.0, 2000.0)
"""Octaves above the paper's high-pass corner, Hz, rounded as octave bands are (IEC 61260). Fingers
are most sensitive to vibration in the middle ones. The paper's spectra are similar up to about 300
Hz."""

assert BAND_EDGES[0] == HIGH_PASS_FREQUENCY

QUIET_SHARE = 1e-6
"""Fraction of the desired signal's power below which a band has no relative error. It is a
thousandth of the amplitude, which is below the sensor's noise."""


@dataclass(frozen=True)
class Band:
    """Frequencies from `low` (included) to `high` (excluded), Hz."""

    low: float
    high: float

    @property
    def name(self) -> str:
        """Name of the band, for example ``30-60 Hz``."""
        return f"{self.low:g}-{self.high:g} Hz"


def bands(rate: float) -> tuple[Band, ...]:
    """Return the bands up to half a sampling rate in Hz, where the last one ends."""
    half = rate / 2
    edges = [edge for edge in BAND_EDGES if edge < half] + [min(half, BAND_EDGES[-1])]
    edges = list(dict.fromkeys(edges))
    return tuple(Band(low, high) for low, high in itertools.pairwise(edges))


def band_nrmse(
    desired: FloatArray, actual: FloatArray, rate: float, chosen: Sequence[Band]
) -> dict[str, float]:
    """Return the error within frequency bands.

    For each band it is the root of the power of (actual - desired) over the power of desired, from
    `metrics.spectra`. By Parseval's theorem this is equal to `metrics.nrmse` of both signals after
    an ideal zero-phase filter of the band.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Aligned signals, m/s^2; at least 16 samples.
    rate : float
        Samples per second.
    chosen : sequence of Band

    Returns
    -------
    dict
        Ratio by the band's name; NaN if the desired signal is below `QUIET_SHARE`, or the spectrum
        has no line.

    Raises
    ------
    ValueError
        As for `metrics.spectra`.
    """
    found = spectra(desired, actual - desired, rate)
    wanted, wrong = found.desired**2, found.actual**2
    least = QUIET_SHARE * float(np.sum(wanted))
    errors = {}
    for band in chosen:
        within = (found.frequency >= band.low) & (found.frequency < band.high)
        reference = float(np.sum(wanted[within]))
        error = float(np.sum(wrong[within]))
        errors[band.name] = math.sqrt(error / reference) if reference > least else math.nan
    return errors
