# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Stamped samples: rate, grid, gaps, sequence and sender; resampling and loops.

All readers of stamps use these functions, and thus find the same rate, grid and start of a bag.
Stamps are nanoseconds of system time.

Stamps are system times, and the clock can be set while samples arrive. A single wrong stamp must
not cause the rejection of later samples.

A message does not identify its publisher, so `SolePublisher` detects messages that several
publishers may have sent. A publisher that comes and goes between two checks does not change the
present number of publishers, so the total number is checked, too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from haptic_accel.core.actuator import MAX_AGE
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
    """Return the time by which the filter of `resampled` extends beyond a sample, s.

    Its delay is zero, as it extends as far before the sample.

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
    """Return a low-pass for `PASS_BAND` of the lowest of `steps` equal parts of the band."""
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
    """Return rate / recording_rate as a fraction with limited terms."""
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


NANOSECONDS = 1_000_000_000
"""Nanoseconds in a second."""

DEFAULT_RATE = 1000.0
"""Samples per second of the paper's servo loop."""

LATENCY = 1
"""Default delay from sample to force, in samples: the minimum for which the due time of a force is
known in advance."""

HIGHEST_LATENCY = 20
"""Maximum latency, samples."""

IDENTIFICATION_LATENCY = 10
"""Default latency of an identification, samples. A sweep is not a closed loop, and can wait long
enough that no force is late."""

IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

Stamped = tuple[IntArray, FloatArray]
"""Stamps in ns, shape (n,), and vectors, shape (n, 3), in order of arrival."""

IMPLAUSIBLE = 1e9
"""Magnitude above which a value cannot come from a sensor or motor, in SI units. It indicates
damage, and its square may overflow."""

SAME_RATE = 0.1
"""Maximum relative difference between a measured and a stated rate that count as equal."""

WHOLE_RATE = 1e-3
"""Maximum relative difference between a measured rate and a whole number of Hz for rounding."""

SPARSE = 10.0
"""Number of grid points per sample above which stamps count as without a grid."""

RARE = 0.01
"""Maximum fraction of longer steps that count as gaps of a recording, or as a clock that was set
forward."""

LONGEST_STEP = 1.5
"""Step between successive stamps, in periods, above which samples are missing."""

RELEASED = 0.1
"""Duration of silence, or of zero force, after which arms count as uncoupled, s.

Equal to the coupler's default timeout.
"""


def check_latency(latency: int) -> None:
    """Raise a ParameterError for an invalid latency in samples."""
    if not 0 <= latency <= HIGHEST_LATENCY:
        raise ParameterError(f"latency = {latency}: must be from 0 to {HIGHEST_LATENCY} samples")


def half_period(rate: float) -> float:
    """Return half a sampling period, ns: the maximum distance of a sample from its grid point.

    A more distant stamp belongs to another sample; a message with a longer delay is late.

    Examples
    --------
    >>> half_period(1000.0)
    500000.0
    """
    return NANOSECONDS / rate / 2


def same_rate(found: float, stated: float) -> bool:
    """Return True if a measured rate agrees with a stated one within `SAME_RATE`.

    Examples
    --------
    >>> same_rate(995.0, 1000.0), same_rate(500.0, 1000.0)
    (True, False)
    """
    return abs(found - stated) <= SAME_RATE * stated


def sampling_rate(stamps: IntArray, stated: float | None = None) -> float:
    """Return the rate of the sampling grid of stamps, Hz.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        Stamps, ns; some may be missing.
    stated : float, optional
        Expected rate, Hz; returned if the stamps agree with it within `SAME_RATE`.

    Returns
    -------
    float
        A whole number if the measured rate is within `WHOLE_RATE` of one.

    Raises
    ------
    ParameterError
        There are fewer than two different stamps, or they are not on a grid.

    Examples
    --------
    >>> stamps = np.array([0, 1_000_100, 1_999_900, 4_000_000])
    >>> sampling_rate(stamps)
    1000.0
    """
    steps = np.diff(np.sort(stamps))  # np.unique would hash them, which takes 30 times as long
    steps = steps[steps > 0]
    if not len(steps):
        raise ParameterError("rate not found: must have stamps that advance")
    duration = float(steps.sum())
    typical = float(np.median(steps))
    if duration > SPARSE * typical * len(stamps):
        is_gap = steps > round(SPARSE * typical)
        if np.mean(is_gap) > RARE:
            raise ParameterError(
                f"rate not found: {len(stamps)} samples in {duration / NANOSECONDS:.5g} s are not"
                " on a sampling grid"
            )
        # The recorder paused, or a clock was set forward.
        steps, duration = steps[~is_gap], float(steps[~is_gap].sum())
    # Distant stamps on the grid give the period more accurately than adjacent ones.
    found = NANOSECONDS / (duration / max(1.0, float(np.rint(steps / typical).sum())))
    if stated is not None and same_rate(found, stated):
        return stated
    whole = float(round(found))
    return whole if whole and abs(found - whole) <= WHOLE_RATE * whole else found


def grid_indices(stamps: IntArray, start: int, rate: float) -> IntArray:
    """Return the index of the nearest grid point for each stamp.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        Stamps, ns.
    start : int
        Start of the grid, ns.
    rate : float
        Samples per second of the grid.

    Examples
    --------
    >>> grid_indices(np.array([2_000_000, 3_100_000, 4_900_000]), 2_000_000, 1000.0)
    array([0, 1, 3])
    """
    return np.round((stamps - start) * (rate / NANOSECONDS)).astype(np.int64)


def on_grid(where: IntArray, values: FloatArray, length: int) -> tuple[FloatArray, BoolArray]:
    """Arrange samples on a grid; a missing or implausible one repeats the previous one.

    Parameters
    ----------
    where : ndarray of int64, shape (n,)
        Grid index of each sample; samples outside the grid are ignored.
    values : ndarray, shape (n, ...)
        Samples, at least one of them on the grid, finite and below `IMPLAUSIBLE`.
    length : int
        Number of grid points.

    Returns
    -------
    held : ndarray, shape (length, ...)
        Values; before the first sample, the value of that sample.
    seen : ndarray of bool, shape (length,)
        True at grid points with such a sample.

    Examples
    --------
    >>> held, seen = on_grid(np.array([0, 1, 3]), np.array([0.1, 0.2, 0.4]), 4)
    >>> held
    array([0.1, 0.2, 0.2, 0.4])
    >>> seen
    array([ True,  True, False,  True])
    """
    plausible = (np.abs(values) < IMPLAUSIBLE).all(axis=tuple(range(1, values.ndim)))
    within = plausible & (where >= 0) & (where < length)
    source = np.full(length, -1)
    source[where[within]] = np.flatnonzero(within)
    return values[np.maximum.accumulate(source).clip(np.argmax(within))], source >= 0


def missing_samples(stamps: IntArray) -> int:
    """Return the number of samples missing between successive stamps.

    Samples are missing where a step is longer than `LONGEST_STEP` times the median step. They were
    not taken, or were lost in transit.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        Stamps, ns, in order; n at least 2.

    Examples
    --------
    >>> missing_samples(np.array([0, 1, 2, 5, 6]) * 1_000_000)
    2
    """
    steps = np.diff(stamps)
    period = float(np.median(steps))
    if period <= 0:
        return 0
    return int(np.sum(np.rint(steps[steps > LONGEST_STEP * period] / period) - 1))


def coupled_stretches(
    stamps: IntArray, forces: FloatArray, samples: IntArray
) -> list[tuple[int, int]]:
    """Return the first and last stamp of each period in which an arm was coupled, ns.

    An engaged coupler sends forces at every sample, and single zeros when it disengages. A period
    begins with the first force after a silence, possibly zero until the encoders register motion.
    It ends with the last non-zero force before `RELEASED` seconds of silence or zeros. A silence
    in which the arm's samples are missing too is a gap of the recorder, and does not end the
    period.

    Parameters
    ----------
    stamps : ndarray of int64, shape (n,)
        Stamps, ns.
    forces : ndarray, shape (n, 3)
        Forces on the arm's motors, N.
    samples : ndarray of int64, shape (m,)
        Stamps of the arm's samples in order, ns.

    Returns
    -------
    list of tuple of int
        Empty if the arm was never coupled.

    Examples
    --------
    >>> stamps = np.array([0, 1, 2, 3, 900]) * 1_000_000
    >>> forces = np.array([[0.0] * 3, [0.1] * 3, [0.1] * 3, [0.0] * 3, [0.0] * 3])
    >>> coupled_stretches(stamps, forces, np.arange(900) * 1_000_000)
    [(0, 2000000)]
    """
    order = np.argsort(stamps, kind="stable")
    stamps, acting = stamps[order], np.flatnonzero(forces[order].any(axis=1))
    if not len(acting):
        return []
    longest = RELEASED * NANOSECONDS
    ends = np.flatnonzero(np.diff(stamps[acting]) > longest)
    ends = ends[~_unrecorded(stamps, acting[ends], acting[ends + 1], samples)]
    firsts = acting[np.append(0, ends + 1)]
    lasts = acting[np.append(ends, len(acting) - 1)]
    after_silence = np.append(0, np.flatnonzero(np.diff(stamps) > longest) + 1)
    begins = after_silence[np.searchsorted(after_silence, firsts, side="right") - 1]
    # After zeros that followed a period without a silence, the first non-zero force counts.
    begins = np.where(begins > np.append(-1, lasts[:-1]), begins, firsts)
    return list(zip(stamps[begins].tolist(), stamps[lasts].tolist(), strict=True))


def _unrecorded(
    stamps: IntArray, lasts: IntArray, firsts: IntArray, samples: IntArray
) -> BoolArray:
    """Return the gaps between forces without evidence of a release.

    Evidence is a zero force in the gap, or samples of the arm without force for longer than
    `RELEASED`.
    """
    if len(samples) < 2:
        return np.zeros(len(lasts), dtype=bool)
    within = np.searchsorted(samples, stamps[firsts]) - np.searchsorted(samples, stamps[lasts])
    seen = within * float(np.median(np.diff(samples)))
    return np.asarray((firsts == lasts + 1) & (seen <= RELEASED * NANOSECONDS))


IN_A_ROW = 3
"""Number of successive samples older than the last accepted one, with increasing stamps, that
indicate a clock set back. Delayed samples arrive between newer samples."""

_MAX_AGE = round(MAX_AGE * NANOSECONDS)


class SequenceCheck:
    """Accept the samples of one signal that are newer than all before.

    Parameters
    ----------
    rate : float
        Samples per second.

    Attributes
    ----------
    outdated : int
        Number of samples rejected because their stamp differs from now by more than `MAX_AGE`.
    stale : int
        Number of samples rejected because they were not newer than the last.
    refusal : str
        Reason why the newest sample was rejected; empty if it was accepted.
    jump : float
        Clock step just before the last accepted sample, s; 0 if there was none.

    Examples
    --------
    >>> sequence = SequenceCheck(1000.0)
    >>> [sequence.admits(at, at, at) for at in (1_000_000, 2_000_000, 2_000_000, 5_000_000)]
    [True, True, False, True]
    """

    def __init__(self, rate: float) -> None:
        self._period = NANOSECONDS / rate
        self._last: int | None = None
        self._received = 0
        self._refused = self._row = 0
        self.outdated = self.stale = 0
        self.refusal = ""
        self.jump = 0.0

    def begin(self) -> None:
        """Accept the next sample as the first."""
        self._last = None

    def admits(self, stamp: int, now: int, steady: int) -> bool:
        """Count a sample; return True if it may be used.

        Parameters
        ----------
        stamp : int
            Stamp of the sample, ns.
        now, steady : int
            Reception time of the sample, as system time and monotonic time, ns.
        """
        if abs(now - stamp) > _MAX_AGE:
            self.outdated += 1
            self.refusal = f"stamps differ from now by more than {MAX_AGE:g} s"
            return False
        self.jump = 0.0
        if self._last is not None and not self._follows(stamp - self._last, stamp, steady):
            self.stale, self.refusal = self.stale + 1, "stamps do not advance"
            return False
        self._last, self._received, self._row, self.refusal = stamp, steady, 0, ""
        return True

    def _follows(self, advance: int, stamp: int, steady: int) -> bool:
        """Return True if a sample whose stamp advances by a number of ns is acceptable."""
        steps = round(advance / self._period)
        jumped = advance - (steady - self._received)
        if steps == 0:
            return False
        if steps < 0:
            self._row = self._row + 1 if stamp > self._refused else 1
            self._refused = stamp
            if self._row < IN_A_ROW:
                return False
        elif jumped <= _MAX_AGE:
            return True
        self.jump = jumped / NANOSECONDS
        return True


CONFIRMING_LOOKS = 5
"""Number of checks that reject all messages after a sequence number that is not above all earlier
ones. Its publisher is either the present one, which has just replaced another, or one that the
middleware has not counted yet; after these checks it is counted.
"""


class Matched(Protocol):
    """Publishers matched with a subscription, as the middleware counts them."""

    total_count: int
    current_count: int


class SolePublisher:
    """Check whether the messages in a queue come from a single publisher.

    Three observations exclude this: a publisher that came, or left, while there was another one,
    and a sequence number that is not above all earlier ones of the publisher. The last one covers
    the time between a publisher's first message and the middleware's count; therefore the numbers
    of a publisher are remembered while others come and go.

    Parameters
    ----------
    matched : callable
        Returns the present and the total number of publishers; None if they are unchanged.

    Attributes
    ----------
    contenders : int
        Number of publishers that may have sent the messages of the last check.
    changed : bool
        True if publishers came or left between the last two checks.
    current : int
        Number of publishers at the last check.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> counts = SimpleNamespace(total_count=1, current_count=1)
    >>> publisher = SolePublisher(lambda: counts)
    >>> publisher.sole([1, 2]), publisher.sole([1, 3])
    (True, False)
    >>> [publisher.sole([number]) for number in range(4, 10)]
    [False, False, False, False, True, True]
    >>> counts.total_count = 2  # one has come and gone
    >>> publisher.sole([10]), publisher.sole([11])
    (False, True)
    """

    def __init__(self, matched: Callable[[], Matched | None]) -> None:
        self._matched = matched
        self._total = self.current = self._last = self._doubted = 0
        self.contenders, self.changed = 0, False

    def sole(self, numbers: Sequence[int | None]) -> bool:
        """Return True if all messages since the last call come from a single publisher.

        If not, messages that are in the queue after this call may also come from others, and must
        be dropped. A publisher that left meanwhile cannot add more.

        Parameters
        ----------
        numbers : sequence of int or None
            Publisher's number of each message, in order; None if the middleware has none.
        """
        current, total = before = self.current, self._total
        if counts := self._matched():
            self.current, self._total = counts.current_count, counts.total_count
        self.changed = before != (self.current, self._total)
        self.contenders = current + self._total - total
        if self.contenders > 1:
            return False
        if not current:  # numbers of an earlier publisher
            self._last = 0
        self._doubted = max(0, self._doubted - 1)
        for number in numbers:
            if number is not None:
                if number <= self._last:
                    self._doubted = CONFIRMING_LOOKS
                self._last = number
        return not self._doubted
