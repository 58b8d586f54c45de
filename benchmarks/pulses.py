# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reduction of a vibration to pulses, for devices that play one sine a frame.

Controllers of virtual reality, gamepads, and the haptic devices of some teleoperation software
take amplitude, frequency and duration. A pulse has the strength of the vibration in its frame, and
the frequency at which the hand feels the vibration's middle. All else is lost: waveform, direction
and every second frequency.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from haptic_accel import FloatArray
from haptic_accel.core.evaluation.metrics import detection_threshold
from haptic_accel.core.parameters import check_positive_rate

FELT_BAND = 20.0, 500.0
"""Band in which a pulse's frequency is, Hz: of the vibration that counts as felt."""

PADDING = 8
"""Length of the spectrum relative to the frame: lines between those that a frame resolves."""


class Pulse(NamedTuple):
    """Sine that a device plays for a while.

    Attributes
    ----------
    amplitude : float
        Peak acceleration, m/s²; 0 for what a hand does not feel.
    frequency : float
        Hz.
    duration : float
        s.
    """

    amplitude: float
    frequency: float
    duration: float


def pulse(acceleration: FloatArray, rate: float) -> Pulse:
    """Return the pulse for a frame of vibration.

    Parameters
    ----------
    acceleration : ndarray, shape (n,) or (n, axes)
        Vibration in the frame without gravity, at least two samples, m/s².
    rate : float
        Samples per second.

    Returns
    -------
    Pulse
        Its root mean square is that of the vibration. Its frequency is the mean over the power of
        all axes, relative to the power that a hand just detects at each frequency.

    Raises
    ------
    ValueError
        There are fewer than two samples, one is not finite, or the rate is not positive.

    Examples
    --------
    >>> moments = np.arange(100) / 1000.0
    >>> amplitude, frequency, duration = pulse(2 * np.sin(2 * np.pi * 150 * moments), 1000.0)
    >>> round(amplitude, 2), round(frequency), duration
    (2.0, 150, 0.1)
    """
    check_positive_rate(rate)
    frame = np.atleast_2d(acceleration.T)
    count = frame.shape[1]
    if count < 2 or not np.isfinite(frame).all():
        raise ValueError("acceleration: must be at least two finite samples")
    lines = np.asarray(np.fft.rfftfreq(PADDING * count, 1.0 / rate), dtype=np.float64)
    felt = (lines >= FELT_BAND[0]) & (lines <= FELT_BAND[1])
    spectrum = np.fft.rfft(frame * np.hanning(count + 2)[1:-1], PADDING * count)
    power = np.sum(np.abs(spectrum) ** 2, axis=0)[felt] / detection_threshold(lines[felt]) ** 2
    strength = math.sqrt(float(np.mean(np.sum(frame**2, axis=0))))
    if not power.any():
        return Pulse(0.0, FELT_BAND[0], count / rate)
    frequency = float(power @ lines[felt] / power.sum())
    is_felt = strength >= float(detection_threshold(np.array([frequency]))[0])
    return Pulse(math.sqrt(2.0) * strength if is_felt else 0.0, frequency, count / rate)


def pulses(acceleration: FloatArray, rate: float, frames: float) -> list[Pulse]:
    """Return the pulse of each whole frame of a recording.

    A device plays a pulse in the frame after the one that it describes.

    Parameters
    ----------
    acceleration : ndarray, shape (n,) or (n, axes)
        Vibration without gravity, m/s².
    rate : float
        Samples per second.
    frames : float
        Frames per second, at most half the rate.

    Raises
    ------
    ValueError
        A frame has fewer than two samples, one is not finite, or a rate is not positive.
    """
    check_positive_rate(frames)
    ends = np.arange(len(acceleration) * frames // rate + 1) * rate / frames
    edges = np.rint(ends).astype(int)
    return [pulse(acceleration[first:end], rate) for first, end in pairwise(edges)]


def played(given: Sequence[Pulse], rate: float) -> FloatArray:
    """Return the acceleration of a device that plays pulses one after the other.

    The phase has no step between two pulses.

    Parameters
    ----------
    given : sequence of Pulse
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (n,)
        m/s².
    """
    counts = [round(each.duration * rate) for each in given]
    steps = np.repeat([2.0 * math.pi * each.frequency / rate for each in given], counts)
    amplitude = np.repeat([each.amplitude for each in given], counts)
    return np.asarray(amplitude * np.sin(np.cumsum(steps) - steps))
