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

"""Gain and offset of an accelerometer from gravity: one axis held up, then down.

At rest an accelerometer measures the acceleration that balances gravity: one standard gravity
upwards. Turned over, it measures the opposite. Half the difference gives the gain, the mean gives
the offset. An axis off the vertical measures the cosine of the angle: 0.06 % less at 2 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_accel.core.bring_up import STILL
from haptic_accel.core.model import GRAVITY, FloatArray

BLOCKS = 10
"""Number of blocks whose means give the standard error: the noise of samples is correlated."""

STEADY = 0.1
"""Largest difference between the means of the blocks, m/s^2."""

PLAUSIBLE = 0.75, 1.25
"""Range of the gain relative to nominal: a sensor's tolerance is a tenth."""


class CalibrationError(RuntimeError):
    """Error: a measurement yields no calibration; the message is one line."""


@dataclass(frozen=True)
class Rest:
    """Counts of a sensor held still.

    Attributes
    ----------
    mean, error, noise : float
        Mean, its standard error, and standard deviation.
    """

    mean: float
    error: float
    noise: float


@dataclass(frozen=True)
class Calibration:
    """Calibration of one axis.

    Attributes
    ----------
    offset, offset_error : float
        Counts without acceleration, and their standard error.
    gain, gain_error : float
        m/s^2 per count; negative where the sensor is mounted upside down.
    noise : float
        Standard deviation at rest, m/s^2.
    """

    offset: float
    offset_error: float
    gain: float
    gain_error: float
    noise: float

    def parameters(self, axis: str, board: str) -> dict[str, Any]:
        """Return the driver's parameters for an axis of a board, rounded below their errors."""
        return {
            "axis": axis,
            "offset": round(self.offset, 3),
            "gain": float(f"{self.gain:.7g}"),
            "board": board,
        }


def rest(counts: FloatArray, nominal_gain: float) -> Rest:
    """Return mean and noise of a sensor held still.

    Parameters
    ----------
    counts : ndarray
        Counts of one axis, shape (n,), at least `BLOCKS` samples.
    nominal_gain : float
        m/s^2 per count.

    Raises
    ------
    CalibrationError
        The sensor moved, or there are too few samples.
    """
    if len(counts) < BLOCKS:
        raise CalibrationError(f"{len(counts)} samples came, at least {BLOCKS} are needed")
    means = np.array([block.mean() for block in np.array_split(counts, BLOCKS)])
    noise = float(counts.std(ddof=1))
    shaking, drift = noise * nominal_gain, float(np.ptp(means)) * nominal_gain
    if shaking > STILL or drift > STEADY:
        raise CalibrationError(
            f"it moved: standard deviation {shaking:.2f} m/s^2 (at most {STILL:g}), drift"
            f" {drift:.2f} m/s^2 (at most {STEADY:g}); lay it against something firm"
        )
    return Rest(float(counts.mean()), float(means.std(ddof=1)) / math.sqrt(BLOCKS), noise)


def vertical(up: FloatArray, down: FloatArray) -> int:
    """Return the place of the axis that was turned over, the one whose mean differs most.

    Parameters
    ----------
    up, down : ndarray
        Counts in both positions, shapes (n, axes) and (m, axes).

    Examples
    --------
    >>> vertical(np.array([[3.0, 90.0]]), np.array([[5.0, -88.0]]))
    1
    """
    return int(np.argmax(np.abs(up.mean(axis=0) - down.mean(axis=0))))


def calibrate(up: Rest, down: Rest, nominal_gain: float) -> Calibration:
    """Return the calibration from rests with the axis up and axis down.

    Raises
    ------
    CalibrationError
        The difference is far from two standard gravities.
    """
    difference = up.mean - down.mean
    turned = abs(difference) * nominal_gain / (2 * GRAVITY)
    low, high = PLAUSIBLE
    if not low <= turned <= high:
        raise CalibrationError(
            f"up and down differ by {abs(difference) * nominal_gain:.1f} m/s^2, should by about"
            f" {2 * GRAVITY:.1f}; was this axis held up and then down?"
        )
    gain = 2 * GRAVITY / difference
    error = math.hypot(up.error, down.error)
    return Calibration(
        offset=(up.mean + down.mean) / 2,
        offset_error=error / 2,
        gain=gain,
        gain_error=abs(gain * error / difference),
        noise=abs(gain) * math.hypot(up.noise, down.noise) / math.sqrt(2),
    )
