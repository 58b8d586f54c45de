# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Playout of samples that come over a network: as early as they can be had without gaps."""

from __future__ import annotations

import bisect
import math
from collections import Counter, deque
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

from haptic_accel.core.control.bridging import Bridge

Kind = Literal["waiting", "true", "repaired", "concealed"]
WAITING: Final = "waiting"
TRUE: Final = "true"
REPAIRED: Final = "repaired"
CONCEALED: Final = "concealed"
KINDS: Final = (WAITING, TRUE, REPAIRED, CONCEALED)

QUANTILE = 0.99
"""Share of samples that are to have arrived when they are due."""

WINDOW = 3.0
"""Time whose arrivals count, s: hundreds of packets; a drift of 100 ppm is 0.3 ms in it."""

LOWERING = 1e-3
"""Least rate at which the target falls, s/s: after a lull the next burst needs it again. The
excess fades out with the time constant `WINDOW`."""

STEPS = 50
"""Samples in which the delay changes by one sample: a change of pace by 2 %, which is not felt."""

SLACK = 0.5
"""Delay beyond the one sample that whole numbers cost before it is lowered, samples: the tick
may jitter by half of it without a change of pace."""

TOLERANCE = 0.02
"""Lag behind the target that counts as none, samples: rounding of times."""

DECAY = 0.02
"""Time in which a prediction fades out, s: in gaps on the simulated surfaces its error (NRMSE) is
44 to 79 %, within a point of that with 15 or 40 ms; the last value faded out in 5 ms errs by 88
to 137 %."""

RESTING = 0.05
"""Time constant of the mean that it fades to, s: an accelerometer at rest shows gravity."""

MISSED = 0.04
"""Delay beyond what is needed that is not waited off but left out, s: ticks were missed, or a host
stood still; a texture is felt as late from here on (Okamoto et al., IEEE Trans. Haptics 2(3),
2009)."""

JUMP = 1.0
"""Change of a sample's age that is a new clock rather than the network, s."""


class Played(NamedTuple):
    """A sample as it is played.

    Attributes
    ----------
    value : float
        In the unit of the samples; while waiting their former mean, 0 at first.
    kind : str
        ``waiting`` before the first, ``true`` as received, ``repaired`` from a repetition after
        the loss of a packet, ``concealed`` where nothing was received in time.
    """

    value: float
    kind: Kind


class Playout:
    """Plays one sample a tick, late enough that 99 % have arrived, on the receiver's clock.

    The age of a sample is the time of its first arrival less its number over the rate; offset of
    the clocks and least delay of the network are part of it and cancel. What is played is as old
    as the 99 % quantile of the last `WINDOW`, the target, which rises at once and falls slowly,
    but by more than `MISSED` at once. While nothing has to change each tick plays the next sample
    as it is; the delay changes by resampling over `STEPS` samples, or by standing still where
    there is nothing to play. So it follows a drift of the clocks as well.

    Parameters
    ----------
    rate : float
        Samples per second of the sender, and ticks per second of the receiver, Hz.

    Attributes
    ----------
    counts : Counter
        Samples played, by kind, and those that came ``late``: after they had been due.

    Examples
    --------
    >>> playout = Playout(rate=1000.0)
    >>> playout.put(7, [0.5, 0.25], now=3.0)
    >>> playout.take(now=3.0)
    Played(value=0.25, kind='true')
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._rest, self._resting = 0.0, -math.expm1(-1.0 / (RESTING * rate))
        self.counts: Counter[str] = Counter()
        self.clear()

    def clear(self) -> None:
        """Forget all samples and arrivals, as for another sender; the counts go on."""
        self._samples: dict[int, Played] = {}
        self._base = 0  # numbers count from 1970: their ages would have no digits left
        self._newest = 0
        self._stride = math.inf  # samples from one packet to the next
        self._ages: deque[float] = deque(maxlen=math.ceil(WINDOW * self._rate))
        self._sorted: list[float] = []
        self._target, self._aimed = -math.inf, 0.0
        self._place: int | None = None  # in 1 / STEPS of a sample
        self._step = 0
        self._taken = 0.0
        self._bridge = Bridge()
        self._gap = 0

    @property
    def delay(self) -> float:
        """Age of what is played above the least in the last `WINDOW`, s; 0 while waiting."""
        if self._place is None:
            return 0.0
        return self._age(self._place / STEPS, self._taken) - self._sorted[0]

    @property
    def target(self) -> float:
        """Delay that is aimed at, s, as `delay`."""
        return self._target - self._sorted[0] if self._sorted else 0.0

    @property
    def position(self) -> float:
        """Number of the sample that was played last, with its fraction; NaN while waiting."""
        return math.nan if self._place is None else self._place / STEPS

    def put(self, first: int, samples: Sequence[float], now: float) -> None:
        """Take the samples of a packet, of which any number may be known already.

        Parameters
        ----------
        first : int
            Number of the first sample on the sender's clock.
        samples : sequence of float
            Consecutive samples; infinity and NaN count as not received.
        now : float
            Time of arrival on the receiver's clock, s; never backwards.
        """
        newest = first + len(samples) - 1
        if not self._sorted or abs(self._age(newest, now) - self._target) > JUMP:
            self.clear()
            self._base = self._newest = newest
        elif newest > self._newest:
            self._stride = min(self._stride, newest - self._newest)
            self._newest = newest
        due = self._base - 1 if self._place is None else self._place // STEPS
        for number, value in enumerate(samples, first):
            if number in self._samples or number <= due - self._kept or not math.isfinite(value):
                continue
            repaired = newest - number >= self._stride
            self._samples[number] = Played(float(value), REPAIRED if repaired else TRUE)
            if number >= self._base:  # older ones were sent before anybody listened
                self._arrived(self._age(number, now))
                self.counts["late"] += number <= due
        self._aim(now)

    def take(self, now: float) -> Played:
        """Return the sample of a tick; to be called once a tick.

        Parameters
        ----------
        now : float
            Time of the tick on the receiver's clock, s.
        """
        self._taken = now
        played = self._next(now) if self._sorted else Played(self._rest, WAITING)
        self.counts[played.kind] += 1
        return played

    def _next(self, now: float) -> Played:
        if self._place is None:
            self._place = (self._newest - 1) * STEPS
            self._rest = self._samples[max(self._samples)].value
        if self._place % STEPS == 0:
            self._choose_pace(now)
        following = self._place + STEPS + self._step
        if following > self._newest * STEPS and self._spare(following, now) < -TOLERANCE:
            self._place = (
                -(-self._place // STEPS) * STEPS
            )  # and stand there: the delay has to grow
            return self._concealed()
        for number in range(self._place // STEPS, following // STEPS):
            self._samples.pop(number - self._kept, None)
        self._place = following
        return self._received(*divmod(following, STEPS)) or self._concealed()

    def _choose_pace(self, now: float) -> None:
        """Choose whether the delay grows or shrinks by a sample; make up for missed ticks."""
        assert self._place is not None
        spare = self._spare(self._place + STEPS, now)
        if spare > MISSED * self._rate:
            self._place += int(spare) * STEPS
            spare %= 1.0
        self._step = -1 if spare < -TOLERANCE else 1 if spare > 1.0 + SLACK else 0

    def _spare(self, place: int, now: float) -> float:
        """Return the time from the due time of a place to now, samples."""
        return (self._age(place / STEPS, now) - self._target) * self._rate

    def _received(self, number: int, part: int) -> Played | None:
        """Return what was received at a place, between two samples if need be."""
        one = self._samples.get(number)
        if one is not None and part:
            two = self._samples.get(number + 1)
            value = one.value + part / STEPS * (two.value - one.value) if two else 0.0
            one = two and Played(value, max(one.kind, two.kind, key=KINDS.index))
        if one is not None:
            self._bridge.put(one.value)
            self._gap, self._rest = 0, self._rest + self._resting * (one.value - self._rest)
        return one

    def _concealed(self) -> Played:
        self._gap += 1
        weight = max(0.0, 1.0 - self._gap / (DECAY * self._rate))
        predicted = self._bridge.predict(1)[0] if weight else 0.0
        return Played(self._rest + weight * (predicted - self._rest), CONCEALED)

    def _arrived(self, age: float) -> None:
        if len(self._ages) == self._ages.maxlen:
            del self._sorted[bisect.bisect_left(self._sorted, self._ages[0])]
        self._ages.append(age)
        bisect.insort(self._sorted, age)

    def _aim(self, now: float) -> None:
        """Raise the target to the quantile at once; lower it slowly, but at once if far above."""
        if self._sorted:
            quantile = self._sorted[math.ceil(QUANTILE * len(self._sorted)) - 1]
            excess = self._target - quantile
            if excess > MISSED:
                self._target = quantile
            lowering = max(LOWERING, excess / WINDOW) * (now - self._aimed)
            self._target = max(quantile, self._target - lowering)
        self._aimed = now

    def _age(self, number: float, now: float) -> float:
        return now - (number - self._base) / self._rate

    @property
    def _kept(self) -> int:
        """Samples that are known as received after they were played."""
        return math.ceil(JUMP * self._rate)
