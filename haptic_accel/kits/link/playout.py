# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Playout of samples from a network: minimum delay without gaps."""

from __future__ import annotations

import bisect
import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import NamedTuple

from haptic_accel import Axes, Vector
from haptic_accel.core import ACTUATOR_AXES
from haptic_accel.core.tick import LossConcealment

WAITING, TRUE, REPAIRED, CONCEALED = KINDS = ("waiting", "true", "repaired", "concealed")
PLAYED_KINDS = KINDS[1:]
"""Kinds of samples that are played, each worse than the one before."""

QUANTILE = 0.99
"""Fraction of samples that must have arrived when they are due."""

ARRIVAL_WINDOW = 3.0
"""Time window of the arrival statistics, s: hundreds of packets. A drift of 100 ppm adds 0.3
ms."""

LOWERING = 1e-3
"""Minimum rate at which the target falls, s/s; slow, so that the target remains high for the next
burst. The excess decays with the time constant `ARRIVAL_WINDOW`."""

STEPS = 50
"""Number of samples in which the delay changes by one sample: a change of pace by 2 %, which users
do not notice."""

SLACK = 0.5
"""Minimum excess delay that is reduced, in samples, in addition to one sample of rounding. A tick
may jitter by half of this without a pace change."""

TOLERANCE = 0.02
"""Maximum lag behind the target that counts as zero, in samples: rounding of times."""

DECAY = 0.02
"""Time in which a prediction fades out, s. In gaps on the simulated surfaces its error (NRMSE) is
44 to 79 %, and differs by less than a point for 15 or 40 ms. Holding the last value and fading it
out in 5 ms gives errors of 88 to 137 %."""

RESTING = 0.05
"""Time constant of the mean to which predictions fade, s: an accelerometer at rest measures
gravity."""

MISSED = 0.04
"""Excess delay above which samples are skipped, s: ticks were missed, or a host paused. From this
delay on users perceive a texture as late (Okamoto et al., IEEE Trans. Haptics 2(3), 2009)."""

JUMP = 1.0
"""Change of a sample's age that indicates a new clock rather than network delay, s."""


class Played(NamedTuple):
    """Output of the playout for one tick.

    Attributes
    ----------
    value : tuple of float
        Acceleration of the tool, m/s^2; while waiting the mean of earlier samples, 0 at first.
    kind : str
        ``waiting`` before the first sample, ``true`` as received, ``repaired`` from a repetition
        after the loss of a packet, ``concealed`` where nothing was received in time.
    """

    value: Vector
    kind: str


class _Held(NamedTuple):
    """Components of a received sample, and their kind."""

    value: tuple[float, ...]
    kind: str


class Playout:
    """Play one sample per tick on the receiver's clock, with a delay at which 99 % have arrived.

    The age of a sample is its first arrival time minus its number divided by the rate. Clock
    offset and minimum network delay are part of all ages and cancel. The target is the 99 %
    quantile of the ages in the last `ARRIVAL_WINDOW`. The target rises at once and falls slowly;
    an excess above `MISSED` falls at once. With a constant target each tick plays the next sample
    unchanged.
    The delay changes by resampling over `STEPS` samples, or by pausing while there is nothing to
    play. The playout therefore also follows clock drift.

    Parameters
    ----------
    rate : float
        Sampling rate of the sender and tick rate of the receiver, Hz.

    Attributes
    ----------
    counts : Counter
        Number of samples played, by kind, and of ``late`` samples, which arrived after they were
        due.

    Examples
    --------
    >>> playout = Playout(rate=1000.0)
    >>> playout.put(7, [0.5, 0.25], now=3.0)
    >>> playout.play(now=3.0)
    Played(value=(0.0, 0.0, 0.25), kind='true')
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._kept = math.ceil(JUMP * rate)  # samples, after playout
        self._resting = -math.expm1(-1.0 / (RESTING * rate))
        self.counts: Counter[str] = Counter()
        self._begin(ACTUATOR_AXES)

    def clear(self) -> None:
        """Discard all samples and arrivals, for a new sender; the counts continue."""
        self._samples: dict[int, _Held] = {}
        self._base = 0  # numbers count from 1970: ages would lose all precision
        self._newest = 0
        self._stride = math.inf  # samples between successive packets
        self._ages: deque[float] = deque(maxlen=math.ceil(ARRIVAL_WINDOW * self._rate))
        self._sorted: list[float] = []
        self._target, self._aimed = -math.inf, 0.0
        self._position: int | None = None  # in samples / STEPS
        self._step = 0
        self._played_at = 0.0
        self._concealments = [LossConcealment() for _ in self._rest]
        self._gap = 0

    @property
    def delay(self) -> float:
        """Delay of the playout above the minimum in `ARRIVAL_WINDOW`, s; 0 while waiting."""
        if self._position is None:
            return 0.0
        return self._age(self._position / STEPS, self._played_at) - self._sorted[0]

    @property
    def target(self) -> float:
        """Target of `delay`, s."""
        return self._target - self._sorted[0] if self._sorted else 0.0

    @property
    def position(self) -> float:
        """Number of the last played sample, with its fraction; NaN while waiting."""
        return math.nan if self._position is None else self._position / STEPS

    def put(
        self, first: int, samples: Sequence[float], now: float, axes: Axes = ACTUATOR_AXES
    ) -> None:
        """Add the samples of a packet; samples that are already known are ignored.

        Parameters
        ----------
        first : int
            Number of the first sample on the sender's clock.
        samples : sequence of float
            Components of consecutive samples; a sample with infinity or NaN counts as missing.
        now : float
            Arrival time on the receiver's clock, s; must not decrease.
        axes : Axes
            Axes of the components; different axes indicate a new sender.
        """
        if axes is not self._axes and axes != self._axes:
            self._begin(axes)
        size = len(axes.names)
        newest = first + len(samples) // size - 1
        if not self._sorted or abs(self._age(newest, now) - self._target) > JUMP:
            self.clear()
            self._base = self._newest = newest
        elif newest > self._newest:
            self._stride = min(self._stride, newest - self._newest)
            self._newest = newest
        due = self._base - 1 if self._position is None else self._position // STEPS
        for number in range(first, newest + 1):
            if number in self._samples or number <= due - self._kept:
                continue
            position = (number - first) * size
            value = tuple(samples[position : position + size])
            if not math.isfinite(sum(value)):
                continue
            repaired = newest - number >= self._stride
            self._samples[number] = _Held(value, REPAIRED if repaired else TRUE)
            if number >= self._base:  # older samples were sent before the start
                self._arrived(self._age(number, now))
                self.counts["late"] += number <= due
        self._aim(now)

    def play(self, now: float) -> Played:
        """Return the sample of a tick; call it once per tick.

        Parameters
        ----------
        now : float
            Time of the tick on the receiver's clock, s.
        """
        self._played_at = now
        value, kind = self._next(now) if self._sorted else _Held(self._rest, WAITING)
        self.counts[kind] += 1
        return Played(self._axes.vector(value), kind)

    def _begin(self, axes: Axes) -> None:
        """Start at rest, for samples along specified axes."""
        self._axes, self._rest = axes, (0.0,) * len(axes.names)
        self.clear()

    def _next(self, now: float) -> _Held:
        if self._position is None:
            self._position = (self._newest - 1) * STEPS
            self._rest = self._samples[max(self._samples)].value
        if self._position % STEPS == 0:
            self._choose_pace(now)
        following = self._position + STEPS + self._step
        if following > self._newest * STEPS and self._spare(following, now) < -TOLERANCE:
            self._position = -(-self._position // STEPS) * STEPS  # pause: the delay grows
            return self._concealed()
        for number in range(self._position // STEPS, following // STEPS):
            self._samples.pop(number - self._kept, None)
        self._position = following
        return self._received(*divmod(following, STEPS)) or self._concealed()

    def _choose_pace(self, now: float) -> None:
        """Choose whether the delay grows or shrinks by a sample; skip missed ticks."""
        assert self._position is not None
        spare = self._spare(self._position + STEPS, now)
        if spare > MISSED * self._rate:
            self._position += int(spare) * STEPS
            spare %= 1.0
        self._step = -1 if spare < -TOLERANCE else 1 if spare > 1.0 + SLACK else 0

    def _spare(self, position: int, now: float) -> float:
        """Return the time since a position was due, in samples."""
        return (self._age(position / STEPS, now) - self._target) * self._rate

    def _received(self, number: int, part: int) -> _Held | None:
        """Return the received value at a position, interpolated between samples."""
        one = self._samples.get(number)
        if one is not None and part:
            two = self._samples.get(number + 1)
            one = two and _Held(
                _between(one.value, two.value, part / STEPS),
                max(one.kind, two.kind, key=KINDS.index),
            )
        if one is not None:
            for concealment, value in zip(self._concealments, one.value, strict=True):
                concealment.put(value)
            self._gap, self._rest = 0, _between(self._rest, one.value, self._resting)
        return one

    def _concealed(self) -> _Held:
        self._gap += 1
        weight = max(0.0, 1.0 - self._gap / (DECAY * self._rate))
        if not weight:
            return _Held(self._rest, CONCEALED)
        predicted = tuple(concealment.predict(1)[0] for concealment in self._concealments)
        return _Held(_between(self._rest, predicted, weight), CONCEALED)

    def _arrived(self, age: float) -> None:
        if len(self._ages) == self._ages.maxlen:
            del self._sorted[bisect.bisect_left(self._sorted, self._ages[0])]
        self._ages.append(age)
        bisect.insort(self._sorted, age)

    def _aim(self, now: float) -> None:
        """Raise the target to the quantile at once; lower it slowly, or at once if far above."""
        if self._sorted:
            quantile = self._sorted[math.ceil(QUANTILE * len(self._sorted)) - 1]
            excess = self._target - quantile
            if excess > MISSED:
                self._target = quantile
            lowering = max(LOWERING, excess / ARRIVAL_WINDOW) * (now - self._aimed)
            self._target = max(quantile, self._target - lowering)
        self._aimed = now

    def _age(self, number: float, now: float) -> float:
        return now - (number - self._base) / self._rate


def _between(one: tuple[float, ...], two: tuple[float, ...], share: float) -> tuple[float, ...]:
    """Return the components at a share of the way from one value to another."""
    return tuple([a + share * (b - a) for a, b in zip(one, two, strict=True)])
