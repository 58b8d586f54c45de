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

"""Share of an acceleration whose strength a hand cannot distinguish from the desired one.

Desired and actual acceleration are cut into cells of half a second and a third of an octave. A
cell counts if a hand would feel one of the two. The hand could not tell them apart there if their
levels differ by less than the smallest difference that people notice. False vibration, where none
is desired, and missing vibration count as told.

The share compares strength by frequency and time, and nothing else. It ignores phase and waveform:
an inverted or slightly delayed copy has a share of 1, and an unrelated noise of the same spectrum
up to two thirds. It also ignores masking, adaptation and practice. The NRMSE covers phase and
waveform.

The power of all axes of a vector is added in each cell, as if the hand felt the strength of a
vibration regardless of its direction. DFT321 assumes the same (Landin, Romano, McMahan,
Kuchenbecker, EuroHaptics 2010). It is an approximation: direction is among the causes for which
Brisben, Hsiao and Johnson (J. Neurophysiol. 81, 1999) found different thresholds, and people told
vibration in three axes from its reductions to one (Lee, Tombak, Park, Kuchenbecker, IEEE
Transactions on Haptics 15(3), 2022). `metrics.direction_error` covers the direction.
"""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.evaluation.metrics import check_pair, components
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import check_positive_rate

DETECTION = ((10.0, 26e-6), (20.0, 8.5e-6), (160.0, 0.065e-6), (320.0, 0.06e-6))
"""Detection threshold of a vibrating stylus held like a pen: frequency, Hz, and amplitude of the
displacement (peak), m.

Israr, Choi and Tan, "Detection threshold and mechanical impedance of the hand in a pen-hold
posture", IROS 2006: 10 people, sines of 1 s along the stylus, 10 to 500 Hz. The text states 26 um
at 10 Hz, 8.5 um at 20 Hz, a mean slope of -13 dB per octave from 10 to 160 Hz, which gives
0.065 um at 160 Hz, and the minimum, 0.06 um at 320 Hz. These numbers come from a summary of the
paper (github.com/adambickerdike/Stabilisation_Pen, HAP-27); its figure, with the value at 500 Hz,
was not available. Beyond 320 Hz the minimum is used, so that a cell counts rather too early.
"""

JUST_NOTICEABLE = 2.2
"""Smallest difference of two vibrations' levels that people notice, dB.

Israr et al., "Tactual frequency and amplitude discrimination with fixed and roving background",
HAPTICS 2006, 10.1109/HAPTIC.2006.1627110: 2.2 to 2.5 dB for sines of 2 to 200 Hz at the fingertip,
20 to 35 dB above threshold; more beside another vibration.
"""

CELL = 0.5
"""Duration of a cell, s. Its spectral lines, 2 Hz apart, resolve the lowest band, 4.6 Hz wide."""

CENTRES: FloatArray = 1000.0 * 10.0 ** (np.arange(-17, -2) / 10.0)
"""Centres of the third-octave bands (IEC 61260, base ten), 20 to 500 Hz: above the compensator's
high-pass corner, and up to the highest frequency of `DETECTION`'s source."""

_HALF_BAND = 10.0**0.05  # ratio of a band's upper edge to its centre


def detection_threshold(frequency: FloatArray) -> FloatArray:
    """Return the acceleration of a stylus that a hand just detects.

    Parameters
    ----------
    frequency : ndarray, shape (n,)
        Frequencies, Hz.

    Returns
    -------
    ndarray, shape (n,)
        Root mean square of a sine, m/s^2. Between and beyond the points of `DETECTION` the
        displacement is interpolated in logarithms of both, and kept.

    Examples
    --------
    >>> detection_threshold(np.array([20.0, 160.0, 320.0])).round(2)
    array([0.09, 0.05, 0.17])
    """
    known, displacement = np.log(np.array(DETECTION)).T
    peak = np.exp(np.interp(np.log(frequency), known, displacement))
    return np.asarray((2.0 * np.pi * frequency) ** 2 * peak / math.sqrt(2.0))


def indistinguishable(desired: FloatArray, actual: FloatArray, rate: float) -> float:
    """Return the share of cells in which a hand cannot distinguish actual from desired.

    A cell is half a second in a Hann window, half overlapping, within a third-octave band. It
    counts if the level of one of the accelerations reaches `detection_threshold`. Its levels are
    indistinguishable if they differ by at most `JUST_NOTICEABLE`.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,) or (n, k)
        Aligned accelerations without gravity, m/s^2.
    rate : float
        Samples per second; bands beyond half of it are omitted.

    Returns
    -------
    float
        Share from 0 to 1; NaN if no cell counts, or the signals are shorter than a cell.

    Raises
    ------
    ValueError
        The signals differ in length, are empty or not finite, or `rate` is not positive.

    Examples
    --------
    >>> tone = np.sin(2 * np.pi * 100 * np.arange(2000) / 1000.0)
    >>> indistinguishable(tone, 1.2 * tone, 1000.0), indistinguishable(tone, 1.4 * tone, 1000.0)
    (1.0, 0.0)
    """
    check_pair(desired, actual)
    check_positive_rate(rate)
    centres = CENTRES[rate / 2 >= CENTRES * _HALF_BAND]
    first, second = (
        sum(_powers(component, centres, rate) for component in components(signal))
        for signal in (desired, actual)
    )
    felt = np.maximum(first, second) >= detection_threshold(centres) ** 2
    if not felt.any():
        return math.nan
    ratio = 10.0 ** (JUST_NOTICEABLE / 10.0)
    alike = (first <= ratio * second) & (second <= ratio * first)
    return float(np.mean(alike[felt]))


def _powers(signal: FloatArray, centres: FloatArray, rate: float) -> FloatArray:
    """Return the mean square of each cell (rows) in each band (columns), (m/s^2)^2."""
    length = round(CELL * rate)
    if len(signal) < length or not len(centres):
        return np.zeros((0, len(centres)))
    window = np.hanning(length + 1)[:-1]
    pieces = np.lib.stride_tricks.sliding_window_view(signal, length)[:: length // 2]
    lines = np.abs(np.fft.rfft(pieces * window)) ** 2 * (2.0 / (length * np.sum(window**2)))
    frequency = np.fft.rfftfreq(length, 1.0 / rate)[:, np.newaxis]
    within = (frequency >= centres / _HALF_BAND) & (frequency < centres * _HALF_BAND)
    return np.asarray(lines @ within)
