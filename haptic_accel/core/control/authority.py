# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reduction of a controller's force to the fraction that is better than no compensation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from haptic_accel.core.control.response_estimation import latest
from haptic_accel.core.tick import DESIRED, MEASURED, ForceFraction, SampleFilter, Trace

BLOCK = 0.016
"""Time between updates, s: a period of 60 Hz."""

POWER_MEMORY = 0.1
"""Time constant of the running powers and of the fraction, s: some periods of the lowest band."""

CORNER = 9.0
"""Corner of the high-pass of order 2 that removes gravity and the hand's motion, Hz."""

GROWTH = 1.15
"""Factor by which the fraction may exceed the best one. A controller whose error does not
correlate with the desired acceleration thus keeps its full force up to an error of 39 %."""

SLIGHT = 0.015
"""Accepted increase of the error's power over that of no force, relative to it; 0.75 % of the
error. A response must be seen to be judged, and to be learnt."""

SILENT = 0.2
"""Desired acceleration below which the handle's motion counts as noise, m/s^2 RMS: ten times the
arm's own motion and noise."""

LARGEST_NOISE = 1.0
"""Maximum noise, m/s^2 RMS: more than ten times that of the paper's accelerometer. What moves more
in silence is moved by the force."""

QUIET, RINGING, LOUDEST = 0.05, 0.25, 2.0
"""Powers of desired and measured acceleration below which nothing is judged, relative to the
highest of late, and the time constant of that one, s. A handle that rings while the tool lifts off
is worse than none, but hardly adds to the error, and would cost the force of the next contact."""

CAUTIOUS, WARIEST = 0.3, 0.25
"""Time constant with which the use of a reduced fraction falls in silence, s, and its lower bound:
a tool that lands excites the handle more, and otherwise, than what the fraction was found for."""

STIRRED = 0.2
"""Motion of an axis in silence above which the first contact is begun with caution, m/s^2 RMS:
three times the noise of the paper's accelerometer. A resonance amplifies the force for the tool's
noise, and a landing excites it within milliseconds, before anything is seen of it."""

TIMID, FAINTEST = 0.1, 0.06
"""Time constant with which the use of the force falls then, s, and its lower bound: a resonance
with a damping ratio of 0.02 amplifies 25 times."""

LISTENED = 1.0
"""Time of silence after which the noise is known, s: in less, a hand may not have been at rest."""

FALLEN = 0.8
"""Factor of the fraction from one update to the next, or due within `POWER_MEMORY`, below which it
falls; what the force has excited may still ring."""

IDLE_CORRELATION = 0.1
"""Square of the correlation of desired and measured acceleration below which a reduced force is of
no use, so that nobody misses it for a while."""

LEAST_LEFT, RELIEF = 0.7, 2.0
"""Least factor by which limits of the actuator reduce the fraction in an update, and the time
constant with which its bound rises again, s. What is cut off a force that balances a resonance
excites it."""

LOWEST = 1e-3
"""Minimum fraction; even a resonance with a damping ratio of 0.01 is below the noise then."""

FALLING, RISING = 0.1, 2.0
"""Bounds of the factor by which the fraction changes within `POWER_MEMORY`: a resonance takes some
periods to show."""

RECOVERING = 3.0
"""Upper bound where no difference is known: more, and a mode rings before it is seen; less, and
what a force that hardly shows in the noise would teach is never learnt."""

REDUCED, RESTORED = 0.5, 0.9
"""Fraction below which a reduction is reported, and above which its report ends."""

LASTING = 0.8
"""Least duration of a reduction that is reported, s: a hand that jerks causes shorter ones on a
handle as described."""

HUSHED, HUSHED_FOR = 0.1, 0.3
"""Factor of a reduced force while the handle is listened to, and for how long, s. Of what the
force causes, 1 % remains by power; a mode at 60 Hz with a damping ratio of 0.02 rings 0.1 s."""

HEARING = 0.15
"""Part of that time, its end, in which the noise is measured, s."""

HUSHED_EVERY, HUSHED_RARELY, SETTLED_FOR = 1.5, 12.0, 0.3
"""Shortest and longest time from one listening to the next, and from a fall of the fraction to the
first, s of excitation. The time doubles where the noise is `MINOR`."""

MINOR = 0.25
"""Noise that hardly hides a force, relative to the accepted increase of the error's power."""


class Listening:
    """Times at which a reduced force of no use is hushed, and what is heard then.

    Attributes
    ----------
    heard : float
        Power of what moved the handle at the last listening, (m/s^2)^2; 0 before the first.
    """

    def __init__(self) -> None:
        self.heard = 0.0
        # Time since the last listening began, and from then to the next, s.
        self._since = self._next = HUSHED_EVERY
        self._energy = 0.0  # heard in this one, (m/s^2)^2 s

    @property
    def hushes(self) -> bool:
        """True while the force is hushed."""
        return self._since < HUSHED_FOR

    def wait(self, time: float) -> bool:
        """Count the time of excitation without listening, s; return whether the next is due."""
        self._since += time
        return self._since >= self._next

    def postpone(self) -> None:
        """Wait until what a force that falls has excited no longer rings."""
        self._since = min(self._since, self._next - SETTLED_FOR)

    def begin(self) -> None:
        """Hush the force from now on."""
        self._since = self._energy = 0.0

    def hear(self, power: float, time: float, minor: float) -> None:
        """Take a block of the handle's motion into account.

        Parameters
        ----------
        power : float
            (m/s^2)^2.
        time : float
            Duration of the block, s.
        minor : float
            Power below which the noise hides nothing, (m/s^2)^2.
        """
        if self._since >= HUSHED_FOR - HEARING:
            self._energy += power * time
        self._since += time
        if not self.hushes:
            self.heard = self._energy / HEARING
            self._next = min(2 * self._next, HUSHED_RARELY) if self.heard < minor else HUSHED_EVERY


class Authority(ForceFraction):
    """Scale a controller's force to the fraction with the least error.

    For the desired acceleration d and the handle's acceleration y, both through the same
    high-pass, the error of d - s y is least for s = <d y> / <y^2>, and then never above that
    without force. The fraction is multiplied by s, at the pace of the running means, and the means
    are converted to the new fraction. No model of the handle is needed.

    Where y fits d, s is near one or above, and the full force is used, exactly. Where it does not,
    the fraction falls until the error's power is at most `SLIGHT` above that without force. It
    rises again as soon as the response fits, for example because it has been learnt.

    Noise of the sensor, and what else moves the handle, is no harm of the force. It is measured in
    silence, and while a reduced force is of no use: it is hushed for a moment now and then, and
    what the handle moves by all the same is the noise. The force that remains is thus as large as
    is seen above the noise.

    What cannot be seen in time is met with caution: the first contact of a handle that moves in
    silence, and a force that the actuator's limits cut on a handle that is not as described.

    In several axes, the powers of all components are added: one fraction scales the force of all
    coils, as a coil moves the other axes too, and the error counts as that of the vector.

    Parameters
    ----------
    rate : float
        Samples per second.
    traces : sequence of Trace
        Desired acceleration and motion of each axis, the motion as known when the desired
        acceleration was.

    Attributes
    ----------
    fraction : float
        Best factor of the controller's force so far, from `LOWEST` to 1.
    reduced : bool
        True while the force is reduced notably, and has been for `LASTING`.
    noise : float
        Least motion in silence, m/s^2 RMS; infinite while unknown.
    """

    def __init__(self, rate: float, traces: Sequence[Trace]) -> None:
        # Imported here, as scipy.signal is slow to import, and most nodes have no controller.
        from scipy import signal

        super().__init__()
        self._rate, self.traces, self._axes = rate, [*traces], len(traces)
        self._length = max(1, round(BLOCK * rate))
        corner = min(CORNER, 0.4 * rate)
        sections = np.asarray(signal.butter(2, corner, "high", fs=rate, output="sos"))
        # Of few samples scipy.signal.sosfilt takes several times longer, with equal results.
        self._filters = [SampleFilter(sections) for _ in (*traces, *traces)]
        for trace in traces:
            trace.kept = max(trace.kept, 4 * self._length)
        self._delay = 0
        self.reset()

    def follow(self, delay: int) -> None:
        """Judge another controller, whose response appears after a delay in samples."""
        self._delay = delay
        for trace in self.traces:
            trace.kept = max(trace.kept, 4 * self._length + delay)
        self.reset()

    def reset(self) -> None:
        """Return to the full force."""
        self._start = self._taken = self.traces[0].count
        self.used = self.fraction = self._caution = self._ceiling = self.left_over = 1.0
        self._reduced_for = 0.0  # time for which the force is reduced notably, s
        self.reduced = self._changing = self._touched = False
        self._rests: list[float] | None = None
        for each in self._filters:
            each.reset()
        # Running means of <d^2>, <d y>, <y^2>, and of the noise in the last one, (m/s^2)^2.
        self._desired_power = self._common = self._moved = 0.0
        self._still = 0.0  # noise in silence
        self._listening = Listening()
        self._level = 0.0  # highest <d^2> of late, (m/s^2)^2
        self._silent = 0.0  # time of silence so far, s
        self.noise = math.inf

    @property
    def left(self) -> int:
        """Number of samples until `update` has something to do; not positive if it is due."""
        return self._taken + self._length - self.traces[0].count

    def update(self, described: bool) -> None:
        """Update the fraction if enough samples are stored.

        Parameters
        ----------
        described : bool
            True if the handle's response is as described, as far as known. Its motion in silence
            is then not caused by the force.
        """
        count = self.traces[0].count
        length = min(count - self._taken, self.traces[0].stored)
        if length < self._length:
            return
        signals = zip(self._filters, self._signals(length), strict=True)
        passed = [each.process(value) for each, signal in signals for value in signal]
        self._taken = count
        # The components of a vector, one after the other, have the sum of their powers.
        block = np.array(passed).reshape(2, -1)
        desired_power, common, _, moved = (block @ block.T / length).ravel().tolist()
        time = length / self._rate
        pace = time / POWER_MEMORY
        share = -math.expm1(-pace)
        self._desired_power += share * (desired_power - self._desired_power)
        self._level = max(self._level * math.exp(-time / LOUDEST), self._desired_power)
        self._ceiling = min(1.0, self._ceiling * math.exp(time / RELIEF))
        if self.left_over < 1.0 and not described:
            self._ceiling = min(self._ceiling, max(LEAST_LEFT, self.left_over) * self.fraction)
        self.left_over = 1.0
        loud = desired_power >= max(SILENT**2, QUIET * self._level)
        self._touched |= loud
        if loud and self._is_hushed(moved, time):
            return
        self._common += share * (common - self._common)
        self._moved += share * (moved - self._moved)
        moving = moved >= max(LARGEST_NOISE**2, RINGING * self._level) and not described
        if loud or moving:
            rising = RECOVERING if described else RISING
            # `_change` is relative to what is used.
            change = min(max(self._caution * self._change(), FALLING), rising)
            self._changing = not FALLEN < change <= 1.0
            self._scale(change**pace, RISING**pace)
        elif self._desired_power < SILENT**2:
            if self.fraction < RESTORED and not described:
                self._scale(1.0, math.exp(-time / CAUTIOUS))
            elif self._still > self._axes * STIRRED**2 and not self._touched:
                self._scale(1.0, math.exp(-time / TIMID), FAINTEST)
            self._still += share * (moved - self._still)
            self._silent += time
            if self._silent >= LISTENED:
                self.noise = min(self.noise, math.sqrt(self._still))
        limit = RESTORED if self._reduced_for else REDUCED
        self._reduced_for = self._reduced_for + time if self.fraction < limit else 0.0
        self.reduced = self._reduced_for >= LASTING

    def _signals(self, length: int) -> list[list[float]]:
        """Return the latest desired accelerations, due after the delay, and motions.

        Until a first measurement the handle is taken to be at rest: gravity is no step.
        """
        delay, start = self._delay, self._start
        desired = [latest(each, DESIRED, length, delay, start).tolist() for each in self.traces]
        moved = [latest(each, MEASURED, length).tolist() for each in self.traces]
        first = 0 if self._rests else self._first_known(length)
        if first == length:
            return [*desired, *[[0.0] * length for _ in moved]]
        self._rests = self._rests or [each[first] for each in moved]
        for each, rest in zip(moved, self._rests, strict=True):
            each[:] = [0.0] * first + [value - rest for value in each[first:]]
        return desired + moved

    def _first_known(self, length: int) -> int:
        """Return the place of the first measurement among the latest samples."""
        trace = self.traces[-1]
        unknown = {*trace.missing, *trace.saturated}
        places = range(trace.count - length, trace.count)
        return next((n for n, place in enumerate(places) if place not in unknown), length)

    @property
    def _noise(self) -> float:
        """Power of what the force does not cause, (m/s^2)^2; 0 while unknown."""
        return max(self._still, self._listening.heard)

    def _is_hushed(self, moved: float, time: float) -> bool:
        """Listen to the handle, if it is due; return whether the force is hushed."""
        listening = self._listening
        if not listening.hushes:
            is_due = listening.wait(time)
            idle = self._common**2 < IDLE_CORRELATION * self._moved * self._desired_power
            if self.fraction > REDUCED or self._changing or not (is_due and idle):
                return False
            listening.begin()
            self._scale(1.0, HUSHED / self._caution)
            return True
        listening.hear(moved, time, MINOR * SLIGHT * self._desired_power)
        if not listening.hushes:
            self._scale(1.0, 1.0 / self._caution)
        return True

    def _change(self) -> float:
        """Return the factor to the best fraction, or to the one that is accepted."""
        moved = max(self._moved - self._noise, 1e-3 * self._noise, 1e-9)
        best = self._common / moved
        accepted = math.sqrt(SLIGHT * self._desired_power / moved)
        if best > 0.0:
            return math.hypot(GROWTH * best, accepted)
        # Where change^2 <y^2> - 2 change <d y> = SLIGHT <d^2>.
        return best + math.hypot(best, accepted)

    def _scale(self, change: float, caution: float, wariest: float = WARIEST) -> None:
        """Multiply fraction and caution, and adapt the means to the new force."""
        before, full = self.used, self.fraction
        self.fraction = max(LOWEST, min(self.fraction * change, self._ceiling))
        if self.fraction < FALLEN * full:
            self._listening.postpone()
        lowest = min(self._caution, HUSHED if self._listening.hushes else wariest)
        self._caution = min(max(lowest, self._caution * caution), 1.0)
        # Less than the fraction after silence.
        self.used = self.fraction * self._caution
        change = self.used / before
        self._common *= change
        self._moved += (change**2 - 1.0) * max(0.0, self._moved - self._noise)
