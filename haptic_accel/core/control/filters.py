# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Design of discrete filters as second-order sections, and filters of complete signals."""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.model import ApproximateModel, ComplexArray, FloatArray, Suspension
from haptic_accel.core.parameters import ParameterError

# scipy.signal takes half a second to import: only the design of a filter needs it.

HIGH_PASS_ORDER = 4
"""Order of the Butterworth high-pass (paper, section III)."""

HIGH_PASS_FREQUENCY = 15.0
"""Corner frequency of the high-pass, Hz (paper, section III)."""


MOTION_SHARE = 1 / 3
"""Fraction of the high-pass corner below which acceleration counts as the hand's own motion.
Strokes reverse below 4 Hz, where the desired acceleration is attenuated by 38 dB (paper's
corner)."""


def high_pass(frequency: float, rate: float) -> FloatArray:
    """Return the sections of the paper's 4th-order Butterworth high-pass.

    Parameters
    ----------
    frequency : float
        Corner, Hz.
    rate : float
        Samples per second, more than twice `frequency`.
    """
    from scipy import signal

    sections = signal.butter(HIGH_PASS_ORDER, frequency, "highpass", fs=rate, output="sos")
    return np.asarray(sections, dtype=float)


def high_passed(tool: FloatArray, corner: float, rate: float) -> FloatArray:
    """Return a compensator's desired acceleration for a tool that is initially at rest.

    Parameters
    ----------
    tool : ndarray, shape (n,) or (n, k)
        Acceleration of the tool, m/s^2.
    corner : float
        Corner of the high-pass, Hz.
    rate : float
        Samples per second.
    """
    from scipy import signal

    return np.asarray(signal.sosfilt(high_pass(corner, rate), tool - tool[0], axis=0))


def high_pass_response(corner: float, frequency: FloatArray, rate: float) -> ComplexArray:
    """Return the response of the compensator's high-pass at frequencies in Hz."""
    return section_response(high_pass(corner, rate), frequency, rate)


def section_response(sections: FloatArray, frequency: FloatArray, rate: float) -> ComplexArray:
    """Return the response of second-order sections at frequencies in Hz."""
    z = np.exp(2j * np.pi * frequency / rate)
    response = np.ones(len(frequency), dtype=np.complex128)
    for section in sections:
        response = response * np.polyval(section[:3], z) / np.polyval(section[3:], z)
    return response


def check_corner(rate: float, high_pass_frequency: float) -> None:
    """Reject a rate in Hz that is too low for a high-pass corner in Hz.

    Raises
    ------
    ParameterError
        The corner is above half the rate.
    """
    if not (math.isfinite(rate) and rate > 2 * high_pass_frequency > 0):
        raise ParameterError(
            f"rate = {rate:g}: must be above twice high_pass_frequency"
            f" = {high_pass_frequency:g} Hz"
        )


def without_hand_motion(
    acceleration: FloatArray, high_pass_frequency: float, rate: float
) -> FloatArray:
    """Remove gravity and the hand's own motion, and nothing else, from a complete signal.

    The compensator's high-pass removes both from the desired acceleration. A zero-phase filter at
    a third of its corner removes both from the handle's acceleration. With a filter that shifts
    phase or removes desired motion, correct motion of the handle would count as error.

    Parameters
    ----------
    acceleration : ndarray, shape (n,) or (n, k)
        Signal to be filtered, m/s^2.
    high_pass_frequency : float
        Corner of the compensator's high-pass, Hz.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, of the same shape
        Filtered signal, m/s^2. The gain is 0.5 at a third of the corner and 0.9998 at the corner.
    """
    from scipy import signal

    sections = high_pass(high_pass_frequency * MOTION_SHARE, rate)
    offset = acceleration - acceleration[:1]  # exactly zero for a handle at rest
    level = offset - np.mean(offset, axis=0)

    def twice(values: FloatArray) -> FloatArray:
        once = signal.sosfilt(sections, values, axis=0)
        return np.asarray(signal.sosfilt(sections, once[::-1], axis=0)[::-1])

    # The first pass starts within the hand's motion, and this step disturbs 0.3 s. The second pass
    # starts where the first has removed the motion. Each half is therefore taken from the order of
    # passes whose second pass starts in that half. (scipy's sosfiltfilt extends the last sample,
    # which includes texture.)
    middle = len(level) // 2
    return np.concatenate([twice(level[::-1])[::-1][:middle], twice(level)[middle:]])


def comparable(
    desired: FloatArray, handle: FloatArray, high_pass_frequency: float, rate: float
) -> tuple[FloatArray, FloatArray]:
    """Return desired and actual acceleration without the hand's own motion, from aligned signals.

    Both pass the filter of `without_hand_motion`, so a handle that moves exactly as desired has no
    error, not even at the ends of a signal.

    Parameters
    ----------
    desired, handle : ndarray, shape (n,) or (n, k)
        Desired acceleration and the handle's, shifted back by its delay, m/s^2.
    high_pass_frequency, rate : float
        As for `without_hand_motion`.
    """
    first = without_hand_motion(desired, high_pass_frequency, rate)
    return first, without_hand_motion(handle, high_pass_frequency, rate)


def inverse_of(model: ApproximateModel, rate: float) -> FloatArray:
    """Return the sections of an approximate model's inverse: desired acceleration to force.

    Each factor of the model is inverted and discretised separately by the bilinear transform. The
    error at the model's 9 to 20 Hz is below 0.2 % at 1 kHz.

    Parameters
    ----------
    model : ApproximateModel
        Model to invert; its zeros become the poles of the result.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (2, 6)
        Second-order sections, N per m/s^2.
    """
    from scipy import signal

    pairs = model.sections()
    sections = [np.concatenate(signal.bilinear(poles, zeros, fs=rate)) for zeros, poles in pairs]
    sections[0][:3] /= model.gain
    return np.array(sections)


def cancelling_sections(suspension: Suspension, corner: float, rate: float) -> FloatArray:
    """Return the sections that convert a known part of the arm's force to the negated coil force.

    In eqs. (1) and (2) of the paper, the arm's force F_r on the handle and the coil's force F_a on
    handle and coil cancel if F_a = -F_r (m_a s^2 + b_s s + k_s) / (m_a s^2). The hand does not
    matter, and neither do mount and sensor, through which both forces pass. Both forces act at the
    same time, so no delay has to be granted. Three poles at a corner below the perceptible
    frequencies replace the two integrations and remove the steady force; below the corner the arm
    moves the handle as before.

    Parameters
    ----------
    suspension : Suspension
        Parameters of actuator or handle.
    corner : float
        Frequency above which the forces cancel, Hz.
    rate : float
        Samples per second.

    Returns
    -------
    ndarray, shape (2, 6)
    """
    from scipy import signal

    mass = suspension.m_a
    zeros = [*np.roots([1.0, suspension.b_s / mass, suspension.k_s / mass]), 0.0]
    poles = [-2.0 * math.pi * corner] * len(zeros)
    return np.asarray(signal.zpk2sos(*signal.bilinear_zpk(zeros, poles, 1.0, rate)), dtype=float)
