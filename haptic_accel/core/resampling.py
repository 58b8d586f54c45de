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

"""Resampling of signals, and loops without a click."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any

import numpy as np

from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError

LOWEST_RATE, HIGHEST_RATE = 10.0, 1.0e6
"""Range of sampling rates, Hz."""

MOST_SAMPLES = 20_000_000
"""Maximum length before and after resampling: half an hour at 10 kHz, 160 MB."""

PASS_BAND = 0.9
"""Highest frequency without attenuation, as a fraction of half the lower rate."""

ATTENUATION = 80.0
"""Attenuation above half the lower rate, dB."""

_MOST_STEPS = 10_000  # larger term of the resampling ratio; keeps the filter small
RATE_TOLERANCE = 1.0e-4  # maximum relative error of the ratio


def resampled(samples: FloatArray, recording_rate: float, rate: float) -> FloatArray:
    """Change the sampling rate without aliasing and without delay.

    A linear-phase low-pass (Kaiser window) passes frequencies below `PASS_BAND` of the lower
    Nyquist frequency, and attenuates those above it by `ATTENUATION`. Beyond its ends the signal
    is extended along the line through its first and last sample, so that an offset causes no step
    there.

    Parameters
    ----------
    samples : ndarray, shape (n, ...)
        Signals to resample, by time.
    recording_rate, rate : float
        Samples per second before and after. Their ratio is met within 1e-4, and exactly for a
        ratio of whole numbers up to ten thousand, such as 44100 to 1000.

    Returns
    -------
    ndarray, shape (ceil(n * rate / recording_rate), ...)
        Resampled signal; its first sample has the same time as before.

    Raises
    ------
    ParameterError
        A rate is out of range.
    """
    ratio = _ratio(checked_rate("recording_rate", recording_rate), checked_rate("rate", rate))
    up, down = ratio.numerator, ratio.denominator
    if up == down:
        return samples.copy()
    from scipy import signal

    low_pass = _low_pass(max(up, down))
    result = signal.resample_poly(samples, up, down, window=low_pass, padtype="line")
    return np.asarray(result, dtype=np.float64)


def look_ahead(recording_rate: float, rate: float) -> float:
    """Return the time by which the filter of `resampled` reaches beyond a sample, s.

    Its delay is zero, as it also reaches as far before the sample.

    Examples
    --------
    >>> look_ahead(1000.0, 1000.0), round(look_ahead(1000.0, 960.0), 4)
    (0.0, 0.0523)
    """
    ratio = _ratio(checked_rate("recording_rate", recording_rate), checked_rate("rate", rate))
    if ratio == 1:
        return 0.0
    taps = len(_low_pass(max(ratio.numerator, ratio.denominator)))
    return taps // 2 / (recording_rate * ratio.numerator)


def _low_pass(steps: int) -> Any:
    """Return the filter that passes `PASS_BAND` of a band, as a part of `steps` bands."""
    from scipy import signal

    taps, beta = signal.kaiserord(ATTENUATION, (1.0 - PASS_BAND) / steps)
    found: Any = signal.firwin(taps | 1, (1 + PASS_BAND) / 2 / steps, window=("kaiser", beta))
    return found / found.sum()


def crossfaded(samples: FloatArray, rate: float, seconds: float = 0.05) -> FloatArray:
    """Return a loop of a signal that repeats without a click.

    The start of the signal is removed and faded in over its end. The step from last to first
    sample thus also occurs in the original. The weights keep the power of a texture constant
    during the fade; the mean is preserved separately.

    Parameters
    ----------
    samples : ndarray, shape (n, ...)
        Signals to loop, by time.
    rate : float
        Samples per second.
    seconds : float
        Length of the fade, s; less than half the signal. With 0 the signal is unchanged.

    Returns
    -------
    ndarray, shape (n - fade, ...)
        One period of the loop; the fade is `seconds`, rounded to whole samples.

    Raises
    ------
    ParameterError
        `rate` or `seconds` is out of range.
    """
    rate = checked_rate("rate", rate)
    most = max(len(samples) - 1, 0) // 2  # less than half: the loop must start outside the fade
    if not 0.0 <= seconds <= (most + 0.5) / rate:
        raise ParameterError(f"seconds = {seconds}: must be from 0 to {most / rate:g} s")
    fade = min(math.floor(seconds * rate + 0.5), most)
    if fade == 0:
        return samples.copy()
    mean = np.mean(samples, axis=0)
    angle = np.arange(1, fade + 1) / fade * (np.pi / 2)
    angle = angle.reshape(fade, *[1] * (samples.ndim - 1))
    blend = np.cos(angle) * (samples[-fade:] - mean) + np.sin(angle) * (samples[:fade] - mean)
    loop = samples[fade:].copy()
    loop[-fade:] = mean + blend
    return loop


def _ratio(recording_rate: float, rate: float) -> Fraction:
    """Return rate / recording_rate as a fraction of moderate terms."""
    ratio = Fraction(rate) / Fraction(recording_rate)
    if ratio < 1:
        return 1 / _ratio(rate, recording_rate)
    return ratio.limit_denominator(max(int(_MOST_STEPS / ratio), 1))


def checked_rate(name: str, rate: float) -> float:
    """Return a sampling rate in Hz; raise `ParameterError` if it is out of range."""
    if not LOWEST_RATE <= rate <= HIGHEST_RATE:
        raise ParameterError(
            f"{name} = {rate}: must be from {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz"
        )
    return float(rate)
