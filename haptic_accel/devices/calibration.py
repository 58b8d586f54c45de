# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of accelerometers by gravity: of boards in several poses, and of sound cards.

At rest an accelerometer measures the acceleration that balances gravity: one standard gravity
upwards. Turned over, it measures the opposite. Half of the difference determines the gain, the
mean determines the offset. An axis off the vertical measures the cosine of the angle: 0.06 % less
at 2 degrees.

With an axis of the handle upwards in each of several poses, the directions of gravity also give
the rotation from the sensor to the handle.

An input's scale is its acceleration at full scale, m/s², negative for a swapped polarity. Gravity
determines the scale if the input passes constant voltages. Other inputs are compared during
shaking with a calibrated sensor on the same mass, or with a known force on a known mass.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from haptic_accel.core.axes import NAMES
from haptic_accel.core.model import GRAVITY, ComplexArray, FloatArray

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


FULL = 0.999
"""Share of full scale from which on a sample counts as clipped: a card's maximum is 1 - 2^-15."""

MOST_CLIPPED = 2
"""Maximum number of clipped samples in a recording: a single one is a click, not a level."""

LEAST_RANGE = 1e-6
"""Minimum range of a recording, relative to full scale: eight steps of 24 bits. A connected input
has more noise."""

LEAST_TURN = 20.0
"""Minimum change of the mean when a sensor is turned over, relative to its noise; typically 65."""

BAND = 40.0, 300.0
"""Band in which inputs are compared while they are shaken, Hz: above the corner of an AC-coupled
input, of 10 Hz and below, and below the modes of a mount."""

SEGMENT = 0.25
"""Length of a segment of the spectra, s."""

LONGEST_DELAY = 0.1
"""Longest round trip of a card, s."""

LEAST_COHERENCE = 0.9
"""Smallest median coherence in the band."""

MOST_UNEVEN = 0.1
"""Maximum spread of the gain over the band: half the interquartile range, relative."""

MOST_TURNED = math.radians(30.0)
"""Maximum phase of the response relative to an aligned, or inverted, sensor, rad."""

MOST_UNEQUAL = 0.05
"""Largest relative difference between the gains of a strong and of a weak excitation."""

STROKE, HEARD = 3.0, 5.0
"""Assumed RMS of strokes with a contact microphone, m/s² (that of the simulated surfaces), and
minimum ratio of stroke to noise."""

COUNTS = 2.0**23
"""Counts at full scale of a sensor of 24 bits."""

DIGITAL_SENSOR = re.compile(r"333D\d\d +1\d{6}(\d{5})(\d{5})\d{6}")
"""Name of a USB accelerometer of The Modal Shop with a calibration in counts per m/s²: model,
format 1, serial number of six digits, both channels' counts, date (its USB audio interface guide,
MAN-0343)."""


@dataclass(frozen=True)
class InputCalibration:
    """Calibration of one input of a sound card.

    Attributes
    ----------
    scale, scale_error : float
        Acceleration at full scale, and its standard error, m/s²; negative for swapped polarity.
    noise : float
        Standard deviation at rest, m/s².
    is_relative : bool
        True for a sensor whose signal is no acceleration, such as a contact microphone.
    """

    scale: float
    scale_error: float
    noise: float
    is_relative: bool = False

    @property
    def text(self) -> str:
        """Scale and noise for the user."""
        if self.is_relative:
            return (
                f"relative, no acceleration: full scale {self.scale:.4g} for strokes of"
                f" {STROKE:g} m/s^2, noise at rest {self.noise:.2g}"
            )
        return (
            f"full scale {self.scale:.5g} +- {self.scale_error:.1g} m/s^2, noise at rest"
            f" {self.noise:.2g} m/s^2"
        )


def check_level(samples: FloatArray, name: str) -> None:
    """Refuse a recording that clips, or that is from an input without a sensor.

    Parameters
    ----------
    samples : ndarray, shape (n,)
        Samples relative to full scale.
    name : str
        Name of the input for the message.

    Raises
    ------
    CalibrationError

    Examples
    --------
    >>> check_level(np.zeros(100), "input 2")
    Traceback (most recent call last):
    ...
    haptic_accel.devices.calibration.CalibrationError: input 2: constant; is it unplugged, \
muted, or off (phantom or sensor power)?
    """
    clipped = int(np.count_nonzero(~(np.abs(samples) < FULL)))
    if clipped > MOST_CLIPPED:
        raise CalibrationError(
            f"{name}: {clipped} of {len(samples)} samples at full scale, must be at most"
            f" {MOST_CLIPPED}; turn the input's gain down"
        )
    if float(np.ptp(samples)) < LEAST_RANGE:
        raise CalibrationError(
            f"{name}: constant; is it unplugged, muted, or off (phantom or sensor power)?"
        )


def by_gravity(up: FloatArray, down: FloatArray, name: str) -> InputCalibration:
    """Return the calibration of an input whose sensor was held with its axis up, then down.

    Parameters
    ----------
    up, down : ndarray, shape (n,) and (m,)
        Samples relative to full scale.
    name : str
        Name of the input for messages.

    Raises
    ------
    CalibrationError
        The input is AC-coupled, has no sensor, clips, or the sensor moved.
    """
    for samples in (up, down):
        check_level(samples, name)
    difference = abs(float(up.mean() - down.mean()))
    noise = math.hypot(float(up.std()), float(down.std()))
    if difference < LEAST_TURN * noise:
        raise CalibrationError(
            f"{name}: turned over, it changes by {difference / noise:.1f} times its noise, must by"
            f" at least {LEAST_TURN:g}; hold it still; an AC-coupled input does not see gravity:"
            " use by:=reference or by:=force"
        )
    assumed = 2 * GRAVITY / difference
    found = calibrate(rest(up, assumed), rest(down, assumed), assumed)
    return InputCalibration(found.gain, found.gain_error, found.noise)


def by_reference(
    shaken: FloatArray, quiet: FloatArray, reference: FloatArray, rate: float, name: str
) -> InputCalibration:
    """Return the calibration of an input by a calibrated sensor on the same mass.

    Parameters
    ----------
    shaken, quiet : ndarray, shape (n,) and (m,)
        Input during shaking along the axis of both sensors, and at rest, relative to full scale.
    reference : ndarray, shape (n,)
        Calibrated acceleration at the same times as `shaken`, m/s².
    rate : float
        Samples per second.
    name : str
        Name of the input for messages.

    Raises
    ------
    CalibrationError
        The sensors do not move in the same way, or the input has no sensor or clips.
    """
    check_level(shaken, name)
    return _calibration(*_ratio(reference, shaken, rate, name), quiet)


def by_force(
    force: FloatArray, shaken: FloatArray, quiet: FloatArray, rate: float, mass: float, name: str
) -> InputCalibration:
    """Return the calibration of an input on a known mass that is shaken by a known force.

    The response may be delayed, by the card's round trip. Above its suspension's resonance the
    mass moves freely, with the acceleration force by mass.

    Parameters
    ----------
    force : ndarray, shape (n,)
        Force along the sensor's axis, N; the second half is a quarter as strong as the first, to
        detect an automatic gain.
    shaken : ndarray, shape (n,)
        Input from the same time on, relative to full scale.
    quiet : ndarray, shape (m,)
        Input at rest, relative to full scale.
    rate : float
        Samples per second.
    mass : float
        Total mass moved by the force, kg.
    name : str
        Name of the input for messages.

    Raises
    ------
    CalibrationError
        The mass does not move freely, the input's gain follows its level, or the input has no
        sensor or clips.
    """
    check_level(shaken, name)
    late = _delay(force, shaken, round(LONGEST_DELAY * rate))
    middle = len(force) // 2
    strong, weak = (
        _ratio(force[begin : end - late] / mass, shaken[begin + late : end], rate, name)
        for begin, end in ((0, middle), (middle, len(force)))
    )
    unequal = abs(weak[0] / strong[0] - 1)
    if unequal > MOST_UNEQUAL:
        raise CalibrationError(
            f"{name}: a weak signal's gain differs from a strong one's by {unequal:.0%}, must by"
            f" at most {MOST_UNEQUAL:.0%}; switch automatic gain, limiter and noise gate off"
        )
    return _calibration(*strong, quiet)


def relative(stroked: FloatArray, quiet: FloatArray, name: str) -> InputCalibration:
    """Return the scale for which strokes over a surface have the usual strength.

    Parameters
    ----------
    stroked, quiet : ndarray, shape (n,) and (m,)
        Input during strokes, and at rest, relative to full scale.
    name : str
        Name of the input for messages.

    Raises
    ------
    CalibrationError
        The strokes are hardly stronger than the noise, or the input has no sensor or clips.
    """
    check_level(stroked, name)
    strength, noise = float(stroked.std()), float(quiet.std())
    if strength < HEARD * noise:
        raise CalibrationError(
            f"{name}: strokes are {strength / noise:.1f} times the noise at rest, must be at least"
            f" {HEARD:g}; fix the microphone to the gripper, and stroke firmly"
        )
    scale = STROKE / strength
    return InputCalibration(scale, 0.0, scale * noise, is_relative=True)


def digital_scales(name: str) -> tuple[float, float] | None:
    """Return the full scales of both channels from a sensor's name, m/s².

    Parameters
    ----------
    name : str
        Name of the sound card.

    Returns
    -------
    tuple of float, or None
        Full scales; None if the card is not such a sensor.

    Examples
    --------
    >>> scales = digital_scales("333D01 10123455120025600200115: USB Audio (hw:2,0)")
    >>> [round(scale, 1) for scale in scales]
    [163.8, 327.7]
    """
    found = DIGITAL_SENSOR.search(name)
    if not found or "00000" in found.groups():
        return None
    first, second = (COUNTS / int(counts) for counts in found.groups())
    return first, second


def _calibration(gain: float, error: float, quiet: FloatArray) -> InputCalibration:
    scale = 1 / gain
    return InputCalibration(scale, abs(scale) * error, float(abs(scale) * quiet.std()))


def _delay(cause: FloatArray, response: FloatArray, most: int) -> int:
    """Return the delay of a response, samples; segments would otherwise lose delayed parts."""
    from scipy import signal

    correlation = np.abs(signal.correlate(response, cause, "full", "fft"))
    return int(correlation[len(cause) - 1 :][:most].argmax())


def _ratio(cause: FloatArray, response: FloatArray, rate: float, name: str) -> tuple[float, float]:
    """Return the signed gain in `BAND` from a cause, m/s², to a response, and its error."""
    from scipy import signal

    segment = round(SEGMENT * rate)
    lines, of_cause = signal.welch(cause, rate, nperseg=segment)
    _, of_response = signal.welch(response, rate, nperseg=segment)
    _, cross = signal.csd(cause, response, rate, nperseg=segment)
    band = (lines >= BAND[0]) & (lines <= BAND[1])
    with np.errstate(invalid="ignore", divide="ignore"):
        coherence = np.abs(cross[band]) ** 2 / (of_cause[band] * of_response[band])
        gains = cross[band] / of_cause[band]
    seen = float(np.median(np.nan_to_num(coherence)))
    if seen < LEAST_COHERENCE:
        raise CalibrationError(
            f"{name}: coherence {seen:.2f} between {BAND[0]:g} and {BAND[1]:g} Hz, must be at"
            f" least {LEAST_COHERENCE:g}; shake more strongly; is this the input of the sensor"
            " that is shaken?"
        )
    sizes = np.abs(gains)
    low, gain, high = (float(each) for each in np.percentile(sizes, (25, 50, 75)))
    if (uneven := (high - low) / (2 * gain)) > MOST_UNEVEN:
        raise CalibrationError(
            f"{name}: its gain changes by {uneven:.0%} between {BAND[0]:g} and {BAND[1]:g} Hz,"
            f" must by at most {MOST_UNEVEN:.0%}; is the sensor fixed firmly, and does nothing"
            " resonate?"
        )
    # Welch's segments overlap by half.
    records = max(1, 2 * len(cause) // segment - 1)
    error = math.sqrt(max(0.0, 1 - seen) / (2 * seen * records * np.count_nonzero(band)))
    return gain * _sign(gains, name), error


def _sign(gains: ComplexArray, name: str) -> float:
    """Return 1 for a response in phase with its cause, -1 for the opposite phase."""
    turned = gains / np.abs(gains)
    angle = math.atan2(float(np.median(turned.imag)), float(np.median(turned.real)))
    off = min(abs(angle), math.pi - abs(angle))
    if off > MOST_TURNED:
        raise CalibrationError(
            f"{name}: its phase is {math.degrees(off):.0f} degrees off that of what shakes it,"
            f" must be at most {math.degrees(MOST_TURNED):.0f}; does something resonate?"
        )
    return 1.0 if abs(angle) < math.pi / 2 else -1.0
