"""What a count of an accelerometer is, from gravity: one axis held up, then down.

At rest an accelerometer says what holds it against gravity: upwards, one standard gravity. Turned
over it says as much the other way. Half the difference is the gain, the middle the offset. An
axis that is off the vertical by an angle tells its cosine too little: 0.06 % at 2 degrees.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.model import GRAVITY, FloatArray

BLOCKS = 10
"""Parts whose means tell how well the mean is known: neighbouring samples have like noise."""

STILL = 0.3
"""Largest standard deviation of a sensor at rest, m/s^2; that of an ADXL320J is 0.07."""

STEADY = 0.1
"""Largest difference between the means of a rest's parts, m/s^2."""

PLAUSIBLE = 0.75, 1.25
"""Of the nominal gain: a sensor's tolerance is a tenth."""


class CalibrationError(RuntimeError):
    """What was measured is no calibration; the message is one line fit to be shown."""


@dataclass(frozen=True)
class Rest:
    """A sensor that was held still.

    Attributes
    ----------
    mean, error, noise : float
        Of the counts: mean, its standard error, and standard deviation.
    """

    mean: float
    error: float
    noise: float


@dataclass(frozen=True)
class Calibration:
    """Of one axis.

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


def rest(counts: FloatArray, nominal_gain: float) -> Rest:
    """Return what a sensor said that was held still.

    Parameters
    ----------
    counts : ndarray
        Of one axis, shape (n,), at least `BLOCKS` samples.
    nominal_gain : float
        m/s^2 per count.

    Raises
    ------
    CalibrationError
        It moved, or there are too few samples.
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


def calibrate(up: Rest, down: Rest, nominal_gain: float) -> Calibration:
    """Return the calibration from a rest with the axis up and one with it down.

    Raises
    ------
    CalibrationError
        The two are not two standard gravities apart, by far.
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
