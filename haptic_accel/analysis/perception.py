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

"""Perceptual similarity of two accelerations by the metric ST-SIM of the library `vibromaf`.

ST-SIM (Hassen and Steinbach, IEEE Trans. Haptics 2020, ieeexplore.ieee.org/document/8943164), in
the version of `vibromaf` 0.0.8, is a product of two parts. The temporal part, to the power of 2/3,
is the mean correlation of normalised blocks. The spectral part, to the power of 1/3, is the
overlap of the spectra above a perception threshold, relative to the desired spectrum. ST-SIM is
1 for equal signals, near 0 for unrelated ones, and undefined for a negative correlation. It has no
upper bound, as the spectral part exceeds 1 for a stronger actual acceleration. It hardly depends
on amplitude, and thus describes the shape of a vibration, not its strength.

The library's threshold is fixed for signals of 8 kHz; its documentation states neither a rate nor
a unit. Here signals are resampled to that rate and given in m/s^2. Scores for different units are
not comparable. ST-SIM divides by the desired acceleration, block by block. A silent block with
sensor noise in the other signal scores up to 10^79, so such blocks are excluded.

The library's SPQI (Noll et al., IEEE Haptics Symposium 2022) is made for codecs, whose error is
small and in phase, and is not used here. It compares the powers of a block's cosine coefficients.
An exact copy scores 0.04 at half the amplitude or 0.5 ms late, an unrelated signal with the same
spectrum 0.011. No vibration at all scores 0.018, more than any of the paper's controllers.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from haptic_accel.core.model import FloatArray

RATE = 8000
"""Sampling rate of the library's threshold, Hz (`PerceptualThreshold(8000)`)."""

BLOCK = 512
"""Number of samples in a block of the library, at `RATE`; shorter signals have no score."""

PIECE = 10.0
"""Length of the scored pieces, s, whose mean is computed: as long as a trial, and short enough for
the memory."""

MOST_PIECES = 60
"""Maximum number of scored pieces, evenly distributed over a trial. They cover ten minutes, so
that an hour takes no longer."""

FELT = 0.01
"""RMS of the desired acceleration below which nothing is perceptible, m/s^2: a sine of 0.01 um at
200 Hz, just perceptible for the most sensitive people through a cylinder in their grasp (Brisben,
Hsiao and Johnson, J. Neurophysiology 81(4), 1999)."""

MISSING = "ST-SIM needs the library vibromaf: pip install 'haptic_accel[perceptual]'"

OPPOSED = "no ST-SIM: desired and actual acceleration are negatively correlated"
"""Note on a trial whose ST-SIM would be the root of a negative number."""

_FINEST = 1000  # maximum denominator of a ratio of rates


@dataclass(frozen=True)
class Perception:
    """Perceptual score of an actual acceleration against the desired one.

    Attributes
    ----------
    st_sim : float
        Dimensionless: 1 for equal signals, near 0 for unrelated ones, above 1 for a stronger
        actual acceleration of the desired shape; NaN where undefined.
    note : str
        Reason for a missing score; empty otherwise.
    """

    st_sim: float = math.nan
    note: str = ""


def perceive(desired: FloatArray, actual: FloatArray, rate: float) -> Perception:
    """Score the perceptual similarity of two accelerations.

    Parameters
    ----------
    desired, actual : ndarray, shape (n,)
        Aligned signals, m/s^2.
    rate : float
        Samples per second.

    Returns
    -------
    Perception
        Mean over pieces of about `PIECE`, at most `MOST_PIECES`, that are perceptible. There is no
        score without the library, without such a piece, or for less than one block.
    """
    try:
        from vibromaf.metrics.stsim import st_sim  # type: ignore[import-untyped]
    except ImportError:
        return Perception(note=MISSING)
    number = max(round(len(desired) / rate / PIECE), 1)
    scores = []
    edges = np.linspace(0, len(desired), number + 1).astype(int)
    chosen = np.linspace(0, number - 1, min(number, MOST_PIECES)).round().astype(int)
    for piece in (slice(edges[i], edges[i + 1]) for i in chosen):
        reference, distorted = (_resampled(signal[piece], rate) for signal in (desired, actual))
        if len(reference) < BLOCK:
            return Perception(note=f"shorter than {BLOCK / RATE:g} s: no ST-SIM")
        reference, distorted = _felt(reference, distorted)
        if not len(reference):
            continue
        with warnings.catch_warnings(), np.errstate(divide="ignore", invalid="ignore"):
            # Silence is minus infinity in dB, which the library handles correctly.
            warnings.simplefilter("ignore", RuntimeWarning)
            scores.append(_real(st_sim(distorted, reference)))
    if not scores:
        return Perception(note="the desired acceleration is too weak to be felt: no ST-SIM")
    similarity = float(np.mean(scores))
    return Perception(similarity, OPPOSED if math.isnan(similarity) else "")


def _felt(reference: FloatArray, distorted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the blocks of both signals in which the reference is perceptible, concatenated."""
    whole = len(reference) // BLOCK * BLOCK
    blocks, others = (signal[:whole].reshape(-1, BLOCK) for signal in (reference, distorted))
    felt = np.sqrt(np.mean(blocks**2, axis=1)) >= FELT
    return blocks[felt].ravel(), others[felt].ravel()


def _real(score: complex) -> float:
    """Return a score; NaN for the complex root of a negative temporal correlation."""
    return math.nan if isinstance(score, complex) else float(score)


def _resampled(values: FloatArray, rate: float) -> FloatArray:
    from scipy import signal

    ratio = Fraction(RATE / rate).limit_denominator(_FINEST)
    if ratio == 1:
        return values
    return np.asarray(signal.resample_poly(values, ratio.numerator, ratio.denominator))
