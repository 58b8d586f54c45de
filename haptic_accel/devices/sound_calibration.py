# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Calibration of accelerometers on the inputs of a sound card: scale, polarity, noise.

An input's scale is its acceleration at full scale, m/s², negative for a swapped polarity. Gravity
determines the scale if the input passes constant voltages. Other inputs are compared during
shaking with a calibrated sensor on the same mass, or with a known force on a known mass.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from haptic_accel.core.model import GRAVITY, ComplexArray, FloatArray
from haptic_accel.devices.serial.calibration import CalibrationError, calibrate, rest

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
    haptic_accel.devices.serial.calibration.CalibrationError: input 2: constant; is it unplugged, \
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
