# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of an accelerometer by gravity: one axis turned over, or all axes in resting poses.

At rest an accelerometer measures the acceleration that balances gravity: one standard gravity
upwards. Turned over, it measures the opposite. Half of the difference determines the gain, the
mean determines the offset. An axis off the vertical measures the cosine of the angle: 0.06 % less
at 2 degrees.

With an axis of the handle upwards in each of several poses, the directions of gravity also give
the rotation from the sensor to the handle.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.model import GRAVITY, FloatArray

STILL = 0.3
"""Maximum standard deviation of an accelerometer at rest, m/s^2; an ADXL320J has 0.07."""

BLOCKS = 10
"""Number of blocks whose means give the standard error: the noise of samples is correlated."""

STEADY = 0.1
"""Largest difference between the means of the blocks, m/s^2."""

PLAUSIBLE = 0.75, 1.25
"""Range of the gain relative to nominal: a sensor's tolerance is a tenth."""

POSES: Mapping[str, tuple[float, ...]] = {
    f"{name} axis {way}": tuple(sign * (each == name) for each in NAMES)
    for name in NAMES
    for way, sign in (("up", 1.0), ("down", -1.0))
}
"""Resting poses of handle or tool by name, with the upward direction in its frame."""

FEWEST_POSES = len(NAMES)
"""Smallest number of poses for a rotation: with fewer, all directions of gravity lie in a
plane."""

SPREAD = 0.5
"""Smallest singular value of the directions of gravity: 1 for three right angles, 0 in a plane
(assumed limit, which refuses a pose held within 30 degrees of the plane of the others)."""

MAGNITUDE_ERROR = 0.05
"""Largest relative error of gravity in a pose. A larger error shows that gain and offset are not
nominal, or that the sensor was accelerated."""

LARGEST_ANGLE = 10.0
"""Largest angle between measured and stated direction of a pose, degrees: assumed for a handle
that is aligned by eye."""

CONFIDENCE = 0.95
"""Confidence level of the interval of the mounting."""

_GRAVITY_WEIGHT, _DIRECTION_WEIGHT = 1 / (0.002 * GRAVITY), 1 / (0.05 * GRAVITY)
# Gravity is known within 0.2 % (its variation over the earth), the vertical within 3 degrees.


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
        m/s^2 per count; negative if the sensor is mounted upside down.
    noise : float
        Standard deviation at rest, m/s^2.
    """

    offset: float
    offset_error: float
    gain: float
    gain_error: float
    noise: float

    @property
    def text(self) -> str:
        """Gain, offset and noise for the user."""
        return (
            f"gain {self.gain:.6g} +- {self.gain_error:.1g} m/s^2 per count, offset"
            f" {self.offset:.1f} +- {self.offset_error:.1g} counts, noise {self.noise:.3f} m/s^2"
        )

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
        raise CalibrationError(f"samples = {len(counts)}: must be at least {BLOCKS}")
    means = np.array([block.mean() for block in np.array_split(counts, BLOCKS)])
    noise = float(counts.std(ddof=1))
    shaking, drift = noise * nominal_gain, float(np.ptp(means)) * nominal_gain
    if shaking > STILL or drift > STEADY:
        raise CalibrationError(
            f"the sensor moved: standard deviation {shaking:.2f} m/s^2 (at most {STILL:g}), drift"
            f" {drift:.2f} m/s^2 (at most {STEADY:g}); hold it against a firm support"
        )
    return Rest(float(counts.mean()), float(means.std(ddof=1)) / math.sqrt(BLOCKS), noise)


def vertical(up: FloatArray, down: FloatArray) -> int:
    """Return the index of the axis that was turned over, whose mean changes most.

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


@dataclass(frozen=True)
class AxesCalibration:
    """Calibration of all axes, and the mounting of the sensor on handle or tool.

    Attributes
    ----------
    offsets : tuple of float
        Counts of each axis of the sensor without acceleration; 0 if not determined.
    gains : tuple of float
        m/s^2 per count of each axis; nominal if not determined.
    mounting : ndarray, shape (3, 3)
        Axes of the sensor in the frame of handle or tool, one per row. The sensor measures the
        product of this matrix and the acceleration; the transpose gives the acceleration.
    angle : float
        Angle about any axis within which the mounting is right with a probability of 95 %, from
        the angles between measured and stated directions of gravity, degrees.
    noise : float
        Largest standard deviation at rest, m/s^2.
    """

    offsets: tuple[float, ...]
    gains: tuple[float, ...]
    mounting: FloatArray
    angle: float
    noise: float

    @property
    def text(self) -> str:
        """Rotation, gains, offsets and noise for the user."""
        rotation = math.degrees(math.acos(np.clip((np.trace(self.mounting) - 1) / 2, -1, 1)))
        gains, offsets = _listed(self.gains, ".6g"), _listed(self.offsets, ".1f")
        return (
            f"sensor turned by {rotation:.1f} +- {self.angle:.1f} degrees, gains {gains} m/s^2 per"
            f" count, offsets {offsets} counts, noise {self.noise:.3f} m/s^2"
        )

    def parameters(self, board: str) -> dict[str, Any]:
        """Return the driver's parameters for a board."""
        return {
            "mounting": _listed(self.mounting.ravel(), ".6f"),
            "offsets": _listed(self.offsets, ".3f"),
            "gains": _listed(self.gains, ".7g"),
            "board": board,
        }


def calibrate_axes(poses: Mapping[str, Sequence[Rest]], nominal_gain: float) -> AxesCalibration:
    """Return the calibration from resting poses.

    All six `POSES` give gains and offsets too; with fewer they are nominal. The rotation is the
    solution of Wahba's problem by singular values (Kabsch, Acta Crystallographica A32, 1976;
    Markley, J. Astronautical Sciences 36(3), 1988). Gains and offsets are chosen such that gravity
    has its magnitude in each pose; the less exact directions only determine the rest.

    Parameters
    ----------
    poses : mapping of str to sequence of Rest
        Rests of the sensor's axes, by the name of the pose.
    nominal_gain : float
        m/s^2 per count.

    Raises
    ------
    CalibrationError
        There are too few or similar poses, they contradict each other, or gravity differs by more
        than `MAGNITUDE_ERROR`.
    """
    if len(poses) < FEWEST_POSES:
        raise CalibrationError(f"poses = {len(poses)}: must be at least {FEWEST_POSES}")
    names = list(poses)
    counts = np.array([[axis.mean for axis in rests] for rests in poses.values()])
    upward = np.array([POSES[name] for name in names])
    gains, offsets = np.full(len(NAMES), nominal_gain), np.zeros(len(NAMES))
    complete = len(poses) == len(POSES)
    _check_spread(counts - counts.mean(axis=0) if complete else counts, names)
    if complete:
        gains, offsets = _fitted(counts, upward, nominal_gain)
    measured = gains * (counts - offsets)
    _check_magnitudes(measured, gains / nominal_gain, names)
    mounting = _mounting(measured, upward)
    angles = np.degrees(_angles(measured, upward @ mounting.T))
    worst = int(angles.argmax())
    if angles[worst] > LARGEST_ANGLE:
        raise CalibrationError(
            f"{names[worst]}: {angles[worst]:.0f} degrees off the other poses (at most"
            f" {LARGEST_ANGLE:g}): hold them again; was one upside down, or is an axis of the"
            " sensor inverted?"
        )
    noise = gains * np.array([[axis.noise for axis in rests] for rests in poses.values()])
    return AxesCalibration(
        tuple(offsets.tolist()),
        tuple(gains.tolist()),
        mounting,
        _interval(angles, upward),
        float(noise.max()),
    )


def _check_spread(counts: FloatArray, names: Sequence[str]) -> None:
    """Reject poses in which gravity lies in a plane of the sensor."""
    lengths = np.linalg.norm(counts, axis=1, keepdims=True)
    spread = np.linalg.svd(counts / np.maximum(lengths, 1.0), compute_uv=False)[-1]
    if spread < SPREAD:
        raise CalibrationError(
            f"the poses {', '.join(names)} are too alike: gravity must span all directions"
            f" (singular value {spread:.2f}, at least {SPREAD:g})"
        )


def _check_magnitudes(measured: FloatArray, factors: FloatArray, names: Sequence[str]) -> None:
    """Reject implausible gains, and poses in which the magnitude of gravity is wrong."""
    low, high = PLAUSIBLE
    for name, factor in zip(NAMES, factors, strict=True):
        if not low <= factor <= high:
            raise CalibrationError(
                f"gain of axis {name}: {factor:.2f} of the nominal one, must be from {low:g} to"
                f" {high:g}; was each pose held as asked?"
            )
    magnitudes = np.linalg.norm(measured, axis=1)
    worst = int(np.abs(magnitudes - GRAVITY).argmax())
    if abs(magnitudes[worst] / GRAVITY - 1) > MAGNITUDE_ERROR:
        raise CalibrationError(
            f"{names[worst]}: gravity is {magnitudes[worst]:.2f} m/s^2, must be"
            f" {GRAVITY:.2f} within {MAGNITUDE_ERROR:.0%}; all {len(POSES)} poses give the gains"
            " and offsets"
        )


def _fitted(
    counts: FloatArray, upward: FloatArray, nominal_gain: float
) -> tuple[FloatArray, FloatArray]:
    """Return gains and offsets of the sensor's axes."""
    from scipy.optimize import least_squares

    size = GRAVITY / nominal_gain

    def calibrated(unknown: FloatArray) -> FloatArray:
        gains, offsets = np.split(unknown, 2)
        return np.asarray(gains * (counts / size - offsets) * GRAVITY)

    def errors(unknown: FloatArray) -> FloatArray:
        measured = calibrated(unknown)
        expected = GRAVITY * upward @ _mounting(measured, upward).T
        magnitudes = np.linalg.norm(measured, axis=1) - GRAVITY
        return np.concatenate(
            [_GRAVITY_WEIGHT * magnitudes, _DIRECTION_WEIGHT * (measured - expected).ravel()]
        )

    first = np.concatenate([np.ones(len(NAMES)), counts.mean(axis=0) / size])
    factors, offsets = np.split(least_squares(errors, first).x, 2)
    return factors * nominal_gain, offsets * size


def _mounting(measured: FloatArray, upward: FloatArray) -> FloatArray:
    """Return the rotation that best maps upward directions to the measured ones."""
    left, _, right = np.linalg.svd(measured.T @ upward)
    proper = np.diag([1.0, 1.0, np.linalg.det(left @ right)])
    return np.asarray(left @ proper @ right)


def _interval(angles: FloatArray, upward: FloatArray) -> float:
    """Return the half-width of the rotation's interval from the residual angle of each pose.

    Poses perpendicular to an axis contain information about the rotation around it; the inverse of
    the information is the covariance (Shuster and Oh, J. Guidance and Control 4(1), 1981). A pose
    has two angles, the rotation three unknowns; the quantile is that of the F distribution.
    """
    from scipy.special import fdtri

    free = 2 * len(angles) - len(NAMES)
    information = np.eye(len(NAMES)) * len(angles) - upward.T @ upward
    variance = np.sum(angles**2) / free / np.linalg.eigvalsh(information)[0]
    return float(np.sqrt(len(NAMES) * fdtri(len(NAMES), free, CONFIDENCE) * variance))


def _angles(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the angle between vectors in each row, rad."""
    across = np.linalg.norm(np.cross(first, second), axis=1)
    return np.asarray(np.arctan2(across, np.sum(first * second, axis=1)))


def _listed(values: Sequence[float] | FloatArray, form: str) -> str:
    return ", ".join(format(float(each) + 0.0, form) for each in values)
