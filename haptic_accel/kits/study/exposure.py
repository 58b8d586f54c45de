# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Exposure of hand and arm to vibration, against the limits of Directive 2002/44/EC.

ISO 5349-1:2001, Mechanical vibration: measurement and evaluation of human exposure to
hand-transmitted vibration; frequency weighting Wh of its annex A.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy import signal

from haptic_accel import FloatArray
from haptic_accel.core.parameters import check_positive_rate

WORKING_DAY = 8 * 3600.0
"""Reference duration of A(8), s."""

DAY = 86400.0
"""Time over which doses add up to a daily exposure, s."""

HIGH_PASS, LOW_PASS, BAND_Q = 6.310, 1258.9, math.sqrt(0.5)
"""Corners of the band, Hz, and their quality: f1, f2 and Q1 of table A.1."""

TRANSITION, TRANSITION_Q = 15.915, 0.64
"""Transition from constant acceleration to constant velocity, Hz: f3 = f4 and Q2 of table A.1."""

ZERO = -0.22
"""Zero of the digital filter, which keeps the weights within the tolerance of ISO 8041, -11 to +12
%, up to 0.3 of the rate; with poles only, they would be too large."""


class WeightedDose:
    """Dose of frequency-weighted acceleration: the integral of its square.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.

    Attributes
    ----------
    dose : float
        Sum over all samples and axes, m^2/s^3.

    Examples
    --------
    An RMS of 10 m/s^2 at 100 Hz, where the standard's weight is 0.160, for one minute.

    >>> time = np.arange(60_000) / 1000
    >>> dose = WeightedDose(1000.0)
    >>> dose.add(10 * np.sqrt(2) * np.sin(2 * np.pi * 100 * time))
    >>> round(daily_exposure(dose.dose), 2)
    0.07
    """

    def __init__(self, rate: float) -> None:
        check_positive_rate(rate)
        self.dose = 0.0
        self._rate = rate
        self._sections = _weighting(rate)
        self._state: FloatArray | None = None

    def add(self, samples: ArrayLike) -> None:
        """Add samples of one axis, or rows of several axes, m/s^2; missing ones count as 0."""
        values = np.nan_to_num(np.asarray(samples, float), posinf=0.0, neginf=0.0)
        columns = values.reshape(len(values), -1)
        if self._state is None:
            self._state = np.zeros((len(self._sections), 2, columns.shape[1]))
        weighted, self._state = signal.sosfilt(self._sections, columns, axis=0, zi=self._state)
        self.dose += float(np.square(weighted).sum()) / self._rate


def daily_exposure(dose: float) -> float:
    """Return the exposure A(8) of a day's dose in m^2/s^3, m/s^2.

    Examples
    --------
    >>> daily_exposure(2.5**2 * 8 * 3600)
    2.5
    """
    return math.sqrt(dose / WORKING_DAY)


def weights(frequencies: ArrayLike) -> FloatArray:
    """Return the standard's weights at frequencies in Hz.

    Examples
    --------
    >>> weights([12.5, 100]).round(3).tolist()
    [0.958, 0.16]
    """
    s = 2j * np.pi * np.asarray(frequencies, float)
    found = s**2 * (s / _angular(TRANSITION) + 1)
    for corner, quality in _corners(math.inf):
        angular = _angular(corner)
        found = found / (s**2 + angular / quality * s + angular**2)
    return np.asarray(np.abs(found) * (_angular(TRANSITION) * _angular(LOW_PASS)) ** 2)


def _weighting(rate: float) -> FloatArray:
    """Return second-order sections: the standard's poles and zeros, mapped by exp(s/rate)."""
    poles = [
        root
        for corner, quality in _corners(rate)
        for root in np.roots([1, _angular(corner) / quality, _angular(corner) ** 2])
    ]
    zeros = np.array([0, 0, -_angular(TRANSITION)])
    z, p = np.append(np.exp(zeros / rate), ZERO), np.exp(np.array(poles) / rate)
    at = np.exp(1j * _angular(TRANSITION) / rate)
    gain = float(weights(TRANSITION) * np.abs(np.prod(at - p) / np.prod(at - z)))
    return np.asarray(signal.zpk2sos(z, p, gain))


def _corners(rate: float) -> list[tuple[float, float]]:
    """Return the frequencies and qualities of the poles that a sampling rate can have."""
    found = [(HIGH_PASS, BAND_Q), (TRANSITION, TRANSITION_Q), (LOW_PASS, BAND_Q)]
    return [(corner, quality) for corner, quality in found if corner * BAND_Q < rate / 2]


def _angular(frequency: float) -> float:
    return 2 * math.pi * frequency
