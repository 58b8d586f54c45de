# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checks of a new rig's signals, each with its limit and advice for the user."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from haptic_accel import FloatArray
from haptic_accel.devices import MOST_HEARD
from haptic_accel.devices.serial import STILL

MOST_MISSING = 0.01
"""Maximum fraction of missing samples: identification omits trials with more."""

CLIPPED = 3
"""Number of successive equal samples at the signal's extreme that indicate clipping."""

TAP = 8.0
"""Minimum peak of a tap relative to the noise at rest."""

PROBE_FREQUENCY = 150.0
"""Frequency of the probing force, Hz: above the resonances of handle and mount, where the handle's
acceleration follows the force (paper, figure 4), and below the actuator's limits."""

PROBE_FORCES = 0.1, 0.3
"""Amplitudes of the probing force, N: similar to the forces for the paper's textures."""

AUDIBLE = 3.0
"""Minimum response to the probing force relative to the noise in the same band."""

LINEAR = 0.7
"""Minimum ratio of the responses to the small and the large probing force, each per newton:
friction holds a handle against small forces."""

QUIET_BLOCK = 0.01
"""Duration over which vibration is averaged to find its end, s."""

QUIET_SHARE = 0.1
"""Fraction of the driven vibration, in addition to the noise, below which the handle counts as
quiet."""

QUIET_TIME = 0.1
"""Maximum time from the end of the forces until the handle is quiet, s: the board's time-out of 5
ms, and the decay of the handle in a hand."""

GONE_TIME = 1.5
"""Maximum time until a lost device is reported, s; a serial board counts as lost after 1 s."""

CURRENT_ERROR = 0.1
"""Maximum relative error of the measured current: resistors and meters have a few percent."""

ABOVE_BOUND = 1.5, 5.0
"""Factor and addition, percentage points, that convert the least possible error to the limit of
`adaptive` on a rig in a hand; on the simulated rig it stays within 1.25 and 1."""


class Check(NamedTuple):
    """Result of a check.

    Attributes
    ----------
    passed : bool
    text : str
        Measured value and its limit.
    advice : str
        Instruction for the user if the check failed.
    """

    passed: bool
    text: str
    advice: str = ""


def rest_checks(acceleration: FloatArray) -> list[Check]:
    """Check the signal of an accelerometer at rest.

    Parameters
    ----------
    acceleration : ndarray
        Samples, m/s^2, shape (n,); NaN for a missing one.

    Examples
    --------
    >>> import numpy as np
    >>> [check.passed for check in rest_checks(np.full(100, np.nan))]
    [False]
    """
    there = acceleration[~np.isnan(acceleration)]
    missing = len(acceleration) - len(there)
    if not len(there):
        advice = "check the cable and the board's supply; the board's LED shows that it samples"
        return [Check(False, "no signal", advice)]
    counted = Check(
        missing <= MOST_MISSING * len(acceleration),
        f"{missing} of {len(acceleration)} samples missing (at most {MOST_MISSING:.0%})",
        "close other programs, use a port of this machine without a hub, or run at rate:=500",
    )
    noise = float(there.std())
    if noise == 0:
        advice = "the accelerometer is not connected, or is asleep"
        return [counted, Check(False, "the signal is constant", advice)]
    if _is_clipped(there):
        extreme = f"{np.abs(there).max():.0f} m/s^2"
        advice = "use a sensor or a setting with a larger range"
        return [counted, Check(False, f"the signal is clipped at {extreme}", advice)]
    rest = Check(
        noise <= STILL,
        f"noise at rest {noise:.3f} m/s^2 (at most {STILL:g})",
        "lay the device against something firm, away from fans and motors",
    )
    return [counted, rest]


def is_tapped(acceleration: FloatArray, noise: float) -> bool:
    """Return True if a signal, m/s^2, has a peak far above its noise at rest, m/s^2.

    Examples
    --------
    >>> import numpy as np
    >>> is_tapped(np.array([0.1, 9.0, -4.0]), noise=0.1)
    True
    """
    there = acceleration[~np.isnan(acceleration)]
    return len(there) > 0 and float(np.ptp(there)) > 2 * TAP * max(noise, STILL / 4)


def response(force: FloatArray, acceleration: FloatArray, rate: float) -> complex:
    """Return the response to the probing force, m/s^2 per N, by least squares at its frequency.

    Parameters
    ----------
    force, acceleration : ndarray
        Force, N, and acceleration, m/s^2, of the same samples, shape (n,); missing ones are NaN.
    rate : float
        Samples per second, Hz.
    """
    there = ~np.isnan(acceleration)
    phase = 2 * math.pi * PROBE_FREQUENCY / rate * np.flatnonzero(there)
    basis = np.column_stack([np.cos(phase), -np.sin(phase), np.ones(len(phase))])
    signals = np.column_stack([force[there], acceleration[there]])
    (cause, effect), (cause_90, effect_90), _ = np.linalg.lstsq(basis, signals, rcond=None)[0]
    return complex(effect, effect_90) / complex(cause, cause_90)


def probe_checks(small: complex, large: complex, noise: float) -> list[Check]:
    """Check the responses to both probing forces.

    Parameters
    ----------
    small, large : complex
        Responses to `PROBE_FORCES`, m/s^2 per N.
    noise : float
        Amplitude of the noise at the probing frequency, m/s^2.
    """
    amplitude = abs(large) * PROBE_FORCES[1]
    heard = Check(
        amplitude > AUDIBLE * noise,
        f"{PROBE_FORCES[1]:g} N at {PROBE_FREQUENCY:g} Hz moves the handle with"
        f" {amplitude:.2f} m/s^2 (at least {AUDIBLE * noise:.2f})",
        "is the coil connected and the amplifier on? Is the handle free to move along the coil?",
    )
    if not heard.passed:
        return [heard]
    polarity = Check(
        large.real > 0,
        "a positive force pushes the accelerometer "
        + ("forwards" if large.real > 0 else "backwards"),
        "swap the coil's wires, or make the force constant negative",
    )
    ratio = abs(small) / abs(large)
    friction = Check(
        ratio >= LINEAR,
        f"a small force moves it {ratio:.0%} as far per newton as a large one (at least"
        f" {LINEAR:.0%})",
        "friction: free the coil from its housing, and hold the handle more loosely",
    )
    return [heard, polarity, friction]


def apart_check(tool: float, handle: float) -> Check:
    """Check the tool's response to the probing force against the handle's, both m/s^2 per N."""
    return Check(
        tool <= MOST_HEARD * handle,
        f"the tool's accelerometer picks up {tool / handle:.0%} of the handle's motion (at most"
        f" {MOST_HEARD:.0%})",
        "is each accelerometer on its own side, and in its own input? Do the sides touch?",
    )


def quiet_after(acceleration: FloatArray, rate: float, end: int, noise: float) -> float:
    """Return the time until a driven handle is quiet, s; infinite if it stays loud.

    Parameters
    ----------
    acceleration : ndarray
        Samples, m/s^2, shape (n,), without the mean; missing ones are NaN.
    rate : float
        Samples per second, Hz.
    end : int
        Index of the last sample with a force.
    noise : float
        Standard deviation at rest, m/s^2.
    """
    block = max(1, round(QUIET_BLOCK * rate))
    loud = _rms(acceleration[:end])
    limit = math.hypot(QUIET_SHARE * loud, 2 * noise)
    starts = range(end, len(acceleration) - block + 1)
    noisy = [start for start in starts if not _rms(acceleration[start : start + block]) <= limit]
    if not noisy:
        return 0.0
    return math.inf if noisy[-1] == starts[-1] else (noisy[-1] + 1 - end) / rate


def current_check(measured: float, commanded: float) -> Check:
    """Check the measured current, A, through a resistor in place of the coil."""
    return Check(
        abs(measured - commanded) <= CURRENT_ERROR * abs(commanded),
        f"current {measured:g} A for {commanded:g} A (within {CURRENT_ERROR:.0%})",
        "check the amplifier's gain: the board's full scale must be its largest current",
    )


def proof_check(none: float, adaptive: float, least: float) -> Check:
    """Check the errors of the handle's vibration, %, against the lowest possible error."""
    factor, addition = ABOVE_BOUND
    limit = factor * least + addition
    return Check(
        adaptive <= limit,
        f"error {adaptive:.1f} % with adaptive, {none:.1f} % without compensation (at most"
        f" {limit:.1f} %: the least possible with this handle and delay is {least:.1f} %)",
        "identify again with the grip of this trial",
    )


def _rms(values: FloatArray) -> float:
    there = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(there**2))) if len(there) else 0.0


def _is_clipped(values: FloatArray) -> bool:
    """Return True if the extreme value repeats over several samples."""
    at_limit = np.abs(values) >= np.abs(values).max()
    run = np.convolve(at_limit, np.ones(CLIPPED), mode="valid")
    return bool((run >= CLIPPED).any())
