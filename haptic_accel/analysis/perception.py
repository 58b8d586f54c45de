# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Perceptual similarity of two accelerations, by the metric ST-SIM of the library `vibromaf`.

ST-SIM (Hassen and Steinbach, IEEE Trans. Haptics 2020, ieeexplore.ieee.org/document/8943164) as
`vibromaf` 0.0.8 has it: the product of a temporal part, the mean correlation of blocks with their
mean and scale removed, to the power of 2/3, and of a spectral part, the overlap of the spectra
above a threshold of perception over that of the desired one, to the power of 1/3. It is 1 for
equal signals, near 0 for unrelated ones, undefined for a negative correlation, and has no upper
end: the spectral part exceeds 1 where the actual acceleration is stronger. It hardly depends on
amplitude, so it tells the shape of a vibration, not its strength.

The library fixes the threshold for signals of 8 kHz, whatever it is given; its documentation
states neither a rate nor a unit. Here signals are resampled to that rate and given in m/s^2;
scores of one unit do not compare with those of another. ST-SIM divides by the desired
acceleration, block by block: a block of silence with a sensor's noise beside it scores up to
10^79. Such blocks are left out.

The library's SPQI (Noll et al., IEEE Haptics Symposium 2022) is made for codecs, whose error is
small and in phase, and is not used here. It compares the powers of a block's cosine coefficients:
an exact copy scores 0.04 at half the amplitude or 0.5 ms late, an unrelated signal of the same
spectrum 0.011, and no vibration at all 0.018, more than any of the paper's controllers.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from haptic_accel.core.model import FloatArray

RATE = 8000
"""Samples per second that the library's threshold is for (`PerceptualThreshold(8000)`)."""

BLOCK = 512
"""Samples of a block of the library, at `RATE`; less cannot be scored."""

PIECE = 10.0
"""Length of the pieces that are scored, s, of which the mean is taken: as long as a trial, and
short enough not to fill the memory."""

MOST_PIECES = 60
"""Maximum number of pieces that are scored, evenly spread over a trial: those of ten minutes, so
that an hour takes no longer."""

FELT = 0.01
"""RMS of the desired acceleration below which nothing is to be felt, m/s^2: a sine of 0.01 um at
200 Hz, which the most sensitive people just feel through a cylinder that they grasp (Brisben,
Hsiao and Johnson, J. Neurophysiology 81(4), 1999)."""

MISSING = "ST-SIM needs the library vibromaf: pip install 'haptic_accel[perceptual]'"

OPPOSED = "no ST-SIM: desired and actual acceleration are negatively correlated"
"""Note on a trial whose ST-SIM would be the root of a negative number."""

_FINEST = 1000  # largest denominator of a ratio of rates


@dataclass(frozen=True)
class Perception:
    """Perceptual score of an actual acceleration against the desired one.

    Attributes
    ----------
    st_sim : float
        No unit: 1 for equal signals, near 0 for unrelated ones, above 1 where the actual
        acceleration has the desired shape and is stronger; NaN where undefined.
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
        Already aligned, m/s^2.
    rate : float
        Samples per second.

    Returns
    -------
    Perception
        The mean over pieces of about `PIECE`, at most `MOST_PIECES`, that have something to be
        felt; without a score where the library is not installed, there is no such piece, or less
        than one block.
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
            # Silence is minus infinity in dB, which the library then takes as it should.
            warnings.simplefilter("ignore", RuntimeWarning)
            scores.append(_real(st_sim(distorted, reference)))
    if not scores:
        return Perception(note="the desired acceleration is too weak to be felt: no ST-SIM")
    similarity = float(np.mean(scores))
    return Perception(similarity, OPPOSED if math.isnan(similarity) else "")


def _felt(reference: FloatArray, distorted: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the blocks of both in which the reference is to be felt, one after the other."""
    whole = len(reference) // BLOCK * BLOCK
    blocks, others = (signal[:whole].reshape(-1, BLOCK) for signal in (reference, distorted))
    felt = np.sqrt(np.mean(blocks**2, axis=1)) >= FELT
    return blocks[felt].ravel(), others[felt].ravel()


def _real(score: complex) -> float:
    """Return a score; NaN for the complex root of a negative likeness in time."""
    return math.nan if isinstance(score, complex) else float(score)


def _resampled(values: FloatArray, rate: float) -> FloatArray:
    from scipy import signal

    ratio = Fraction(RATE / rate).limit_denominator(_FINEST)
    if ratio == 1:
        return values
    return np.asarray(signal.resample_poly(values, ratio.numerator, ratio.denominator))
