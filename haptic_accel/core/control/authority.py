# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reduction of a controller's force to the fraction that is better than no compensation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from haptic_accel.core.control.estimation import latest
from haptic_accel.core.tick import DESIRED, MEASURED, ForceFraction, SampleFilter, Trace

BLOCK = 0.016
"""Time between updates, s: a period of 60 Hz."""

POWER_MEMORY = 0.1
"""Time constant of the running powers and of the fraction, s: a few periods of the lowest band."""

CORNER = 9.0
"""Corner of the high-pass of order 2 that removes gravity and the hand's motion, Hz."""

GROWTH = 1.15
"""Factor by which the fraction may exceed the best one. A controller whose error does not
correlate with the desired acceleration thus keeps its full force up to an error of 39 %."""

SLIGHT = 0.015
"""Accepted increase of the error's power relative to the power without force; 0.75 % of the error.
Some response must remain measurable for evaluation and learning."""

SILENT = 0.2
"""Desired acceleration below which the handle's motion counts as noise, m/s^2 RMS: ten times the
arm's own motion and noise."""

LARGEST_NOISE = 1.0
"""Maximum noise, m/s^2 RMS: more than ten times that of the paper's accelerometer. Larger motion
during silence is caused by the force."""

QUIET, RINGING, LOUDEST = 0.05, 0.25, 2.0
"""Powers of desired and measured acceleration below which nothing is evaluated, relative to the
recent maximum power of the desired acceleration, and the time constant of this maximum, s. Ringing
of the handle while the tool lifts off hardly adds to the error, and a reduction because of it
would weaken the force of the next contact."""

CAUTIOUS, WARIEST = 0.3, 0.25
"""Time constant with which the use of a reduced fraction decreases during silence, s, and its
lower bound. A landing tool excites the handle more strongly, and with another spectrum, than the
signal for which the fraction was determined."""

STIRRED = 0.2
"""Motion of an axis during silence above which the first contact starts with a smaller force,
m/s^2 RMS: three times the noise of the paper's accelerometer. A resonance amplifies the force that
is caused by the tool's noise, and a landing excites it within milliseconds, before it can be
measured."""

TIMID, FAINTEST = 0.1, 0.06
"""Time constant with which the use of the force then decreases, s, and its lower bound: a
resonance with a damping ratio of 0.02 amplifies 25 times."""

LISTENED = 1.0
"""Duration of silence after which the noise is known, s: in a shorter time, a hand may not be at
rest."""

FALLEN = 0.8
"""Factor of the fraction, from one update to the next or as requested within `POWER_MEMORY`, below
which the fraction counts as decreasing; motion that the larger force excited may still ring."""

IDLE_CORRELATION = 0.1
"""Square of the correlation of desired and measured acceleration below which a reduced force has
no benefit, so that it can be attenuated for a short time."""

LEAST_LEFT, RELIEF = 0.7, 2.0
"""Minimum factor by which limits of the actuator reduce the fraction in an update, and the time
constant with which the resulting bound rises again, s. If a force that balances a resonance is
clipped, the clipped part excites the resonance."""

LOWEST = 1e-3
"""Minimum fraction; even a resonance with a damping ratio of 0.01 is then below the noise."""

FALLING, RISING = 0.1, 2.0
"""Bounds of the factor by which the fraction changes within `POWER_MEMORY`: a resonance is visible
only after a few periods."""

RECOVERING = 3.0
"""Upper bound of this factor while no difference from the description is known. With a larger one,
a mode rings before it is detected; with a smaller one, a response that hardly exceeds the noise is
never learnt."""

REDUCED, RESTORED = 0.5, 0.9
"""Fraction below which a reduction is reported, and above which the report ends."""

LASTING = 0.8
"""Minimum duration of a reduction that is reported, s of excitation: sudden hand motion causes
shorter ones on a handle that matches its description, which last while nothing excites it."""

HUSHED, HUSHED_FOR = 0.1, 0.3
"""Factor of a reduced force during a measurement of the noise, and duration of the measurement, s.
1 % of the power caused by the force remains; a mode at 60 Hz with a damping ratio of 0.02 rings
for 0.1 s."""

HEARING = 0.15
"""Final part of this duration, in which the noise is measured, s."""

HUSHED_EVERY, HUSHED_RARELY, SETTLED_FOR = 1.5, 12.0, 0.3
"""Minimum and maximum time from one noise measurement to the next, and minimum time from a
decrease of the fraction to a measurement, s of excitation. The time doubles while the noise is
`MINOR`."""

MINOR = 0.25
"""Upper bound of negligible noise, relative to the accepted increase of the error's power."""


class Listening:
    """Measurements of noise for which a reduced force without benefit is attenuated.

    Attributes
    ----------
    heard : float
        Power of the handle's motion in the last measurement, (m/s^2)^2; 0 before the first.
    """

    def __init__(self) -> None:
        self.heard = 0.0
        # Time since the start of the last measurement, and from there to the next, s.
        self._since = self._next = HUSHED_EVERY
        self._energy = 0.0  # integral in this measurement, (m/s^2)^2 s

    @property
    def hushes(self) -> bool:
        """True while the force is attenuated for a measurement."""
        return self._since < HUSHED_FOR

    def wait(self, time: float) -> bool:
        """Count the time of excitation between measurements, s; return True if the next is due."""
        self._since += time
        return self._since >= self._next

    def postpone(self) -> None:
        """Wait until motion that was excited before a decrease of the force no longer rings."""
        self._since = min(self._since, self._next - SETTLED_FOR)

    def begin(self) -> None:
        """Start a measurement: attenuate the force from now on."""
        self._since = self._energy = 0.0

    def hear(self, power: float, time: float, minor: float) -> None:
        """Process a block of the handle's motion.

        Parameters
        ----------
        power : float
            Mean power of the block, (m/s^2)^2.
        time : float
            Duration of the block, s.
        minor : float
            Power below which the noise is negligible, (m/s^2)^2.
        """
        if self._since >= HUSHED_FOR - HEARING:
            self._energy += power * time
        self._since += time
        if not self.hushes:
            self.heard = self._energy / HEARING
            self._next = min(2 * self._next, HUSHED_RARELY) if self.heard < minor else HUSHED_EVERY


class Authority(ForceFraction):
    """Scale a controller's force to the fraction with the smallest error.

    For the desired acceleration d and the handle's acceleration y, both after the same high-pass,
    the error d - s y is smallest for s = <d y> / <y^2>, and then never exceeds the error without
    force. The fraction is multiplied by s, at the rate of the running means, and the means are
    converted to the new fraction. No model of the handle is needed.

    If y matches d, s is close to or above one, and the full force is used unchanged. Otherwise the
    fraction decreases until the error's power exceeds the power without force by at most `SLIGHT`.
    It increases again as soon as the response matches, for example after adaptation.

    Sensor noise and motion with other causes must not reduce the force. They are measured during
    silence, and while a reduced force has no benefit: the force is then attenuated for a short
    time, and the remaining motion counts as noise. The force is thus reduced only to a level at
    which its effect is still measurable above the noise.

    The force is reduced in advance where a measurement would come too late: at the first contact
    of a handle that moves during silence, and where the actuator's limits clip the force on a
    handle that differs from its description.

    With several axes, the powers of all components are added. One fraction scales the forces of
    all coils, as a coil also moves the other axes, and the error is that of the vector.

    Parameters
    ----------
    rate : float
        Samples per second.
    traces : sequence of Trace
        Desired acceleration and motion of each axis. The motion is the latest one that was known
        when the desired acceleration was computed.

    Attributes
    ----------
    fraction : float
        Best factor of the controller's force so far, from `LOWEST` to 1.
    reduced : bool
        True if the force has been clearly reduced for at least `LASTING`.
    noise : float
        Minimum motion during silence, m/s^2 RMS; infinite while unknown.
    """

    def __init__(self, rate: float, traces: Sequence[Trace]) -> None:
        # Imported here, as scipy.signal is slow to import, and most nodes have no controller.
        from scipy import signal

        super().__init__()
        self._rate, self.traces, self._axes = rate, [*traces], len(traces)
        self._length = max(1, round(BLOCK * rate))
        corner = min(CORNER, 0.4 * rate)
        sections = np.asarray(signal.butter(2, corner, "high", fs=rate, output="sos"))
        # For few samples, scipy.signal.sosfilt takes several times longer, with equal results.
        self._filters = [SampleFilter(sections) for _ in (*traces, *traces)]
        for trace in traces:
            trace.kept = max(trace.kept, 4 * self._length)
        self._delay = 0
        self.reset()

    def follow(self, delay: int) -> None:
        """Evaluate another controller, whose response appears after a delay in samples."""
        self._delay = delay
        for trace in self.traces:
            trace.kept = max(trace.kept, 4 * self._length + delay)
        self.reset()

    def reset(self) -> None:
        """Return to the full force."""
        self._start = self._last_count = self.traces[0].count
        self.used = self.fraction = self._caution = self._ceiling = self.left_over = 1.0
        self._reduced_for = 0.0  # duration of a clear reduction so far, s
        self.reduced = self._changing = self._touched = False
        self._rests: list[float] | None = None
        for each in self._filters:
            each.reset()
        # Running means of <d^2>, <d y>, <y^2>, (m/s^2)^2; the last one includes the noise.
        self._desired_power = self._common = self._moved = 0.0
        self._still = 0.0  # noise during silence
        self._listening = Listening()
        self._level = 0.0  # recent maximum of <d^2>, (m/s^2)^2
        self._silent = 0.0  # time of silence so far, s
        self.noise = math.inf

    @property
    def left(self) -> int:
        """Number of samples until the next update; not positive if it is due."""
        return self._last_count + self._length - self.traces[0].count

    def update(self, described: bool) -> None:
        """Update the fraction if enough samples are stored.

        Parameters
        ----------
        described : bool
            True if the handle's response matches its description, as far as known. Its motion
            during silence is then not caused by the force.
        """
        count = self.traces[0].count
        length = min(count - self._last_count, self.traces[0].stored)
        if length < self._length:
            return
        signals = zip(self._filters, self._signals(length), strict=True)
        passed = [each.process(value) for each, signal in signals for value in signal]
        self._last_count = count
        # The components of a vector are concatenated: their powers add.
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
            # `_change` is relative to the force in use, not to the fraction.
            change = min(max(self._caution * self._change(), FALLING), rising)
            self._changing = not FALLEN < change <= 1.0
            self._scale(change**pace, RISING**pace)
            limit = RESTORED if self._reduced_for else REDUCED
            self._reduced_for = self._reduced_for + time if self.fraction < limit else 0.0
            self.reduced = self._reduced_for >= LASTING
        elif self._desired_power < SILENT**2:
            if self.fraction < RESTORED and not described:
                self._scale(1.0, math.exp(-time / CAUTIOUS))
            elif self._still > self._axes * STIRRED**2 and not self._touched:
                self._scale(1.0, math.exp(-time / TIMID), FAINTEST)
            self._still += share * (moved - self._still)
            self._silent += time
            if self._silent >= LISTENED:
                self.noise = min(self.noise, math.sqrt(self._still))

    def _signals(self, length: int) -> list[list[float]]:
        """Return the latest desired accelerations, delayed to match the motions, and the motions.

        Until the first measurement, the handle is assumed to be at rest, so that gravity is not a
        step.
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
        """Return the index of the first measurement among the latest samples."""
        trace = self.traces[-1]
        unknown = {*trace.missing, *trace.saturated}
        places = range(trace.count - length, trace.count)
        return next((n for n, place in enumerate(places) if place not in unknown), length)

    @property
    def _noise(self) -> float:
        """Power of motion that is not caused by the force, (m/s^2)^2; 0 while unknown."""
        return max(self._still, self._listening.heard)

    def _is_hushed(self, moved: float, time: float) -> bool:
        """Measure the noise if this is due; return True if the force is attenuated."""
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
        """Return the factor from the force in use to the best force, or to the accepted one."""
        moved = max(self._moved - self._noise, 1e-3 * self._noise, 1e-9)
        best = self._common / moved
        accepted = math.sqrt(SLIGHT * self._desired_power / moved)
        if best > 0.0:
            return math.hypot(GROWTH * best, accepted)
        # Solution of change^2 <y^2> - 2 change <d y> = SLIGHT <d^2>.
        return best + math.hypot(best, accepted)

    def _scale(self, change: float, caution: float, wariest: float = WARIEST) -> None:
        """Multiply fraction and caution, and convert the means to the new force."""
        before, full = self.used, self.fraction
        self.fraction = max(LOWEST, min(self.fraction * change, self._ceiling))
        if self.fraction < FALLEN * full:
            self._listening.postpone()
        lowest = min(self._caution, HUSHED if self._listening.hushes else wariest)
        self._caution = min(max(lowest, self._caution * caution), 1.0)
        # After silence, the force in use is less than the fraction.
        self.used = self.fraction * self._caution
        change = self.used / before
        self._common *= change
        self._moved += (change**2 - 1.0) * max(0.0, self._moved - self._noise)
