# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of sensor faults: a broken accelerometer or cable, and howling."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from haptic_accel.core.control.estimation import latest
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.model import FloatArray
from haptic_accel.core.outliers import LARGEST_SHARE, outliers
from haptic_accel.core.tick import DESIRED, FORCE, MEASURED, SampleFilter, Trace

PERIOD = 0.5
"""Time between two checks, s."""

SEARCHED = 512
"""Number of latest samples that are searched for spikes and for changes."""

UNUSABLE_SHARE = 0.1
"""Fraction of unusable samples above which a warning is reported; a busy computer loses fewer
(assumed)."""


class SensorWatch:
    """Check of the accelerometers of tool and handle, once per `PERIOD`.

    Parameters
    ----------
    rate : float
        Sampling rate, Hz.
    traces : sequence of Trace
        Samples of each coil.

    Attributes
    ----------
    warning : str
        Accelerometer and its defect; empty if none is detected.
    """

    def __init__(self, rate: float, traces: Sequence[Trace]) -> None:
        self._period, self._traces, self._unusable = round(PERIOD * rate), traces, [0, 0]
        for trace in traces:
            trace.kept = max(trace.kept, SEARCHED)
        self.reset()

    def reset(self) -> None:
        """Discard the results; the counts of unusable samples continue."""
        self._count, self.warning = 0, ""

    def update(self, tool: int, handle: int) -> int:
        """Check the sensors if this is due; return the number of samples to the next check.

        Parameters
        ----------
        tool, handle : int
            Number of missing, saturated and non-numeric samples of each accelerometer since the
            start.
        """
        passed = self._traces[0].count - self._count
        if passed < self._period:
            return self._period - passed
        self.warning = ""
        for name, row, unusable in (("tool", DESIRED, tool), ("handle", MEASURED, handle)):
            share = (unusable - self._unusable[row]) / passed
            self._unusable[row] = unusable
            self.warning = self.warning or self._defect(name, row, share)
        self._count += passed
        return self._period

    def _defect(self, name: str, row: int, unusable: float) -> str:
        """Return the defect of an accelerometer; empty if there is none."""
        signals = [latest(trace, row, SEARCHED) for trace in self._traces]
        is_still = row == MEASURED and not np.any(np.ptp(signals, axis=1))
        if is_still and any(latest(trace, FORCE, SEARCHED).any() for trace in self._traces):
            return f"the {name}'s accelerometer does not change while a force acts"
        if unusable >= UNUSABLE_SHARE:
            return f"{unusable:.0%} of the {name}'s samples are missing, saturated or not numbers"
        spikes = max(np.mean(outliers(signal)) for signal in signals)
        if spikes > LARGEST_SHARE:
            return f"{spikes:.0%} of the {name}'s samples are spikes, as from a broken connection"
        return ""


HEARS = (
    "the tool's sensor picks up the handle: its vibration ends with the force; none took over;"
    " check the cables and positions of both sensors"
)
"""Message about a force that sustains itself."""

HOP, WINDOW = 8e-3, 24e-3
"""Period of the evaluations, and length of their window, s."""

LEAST_FORCE, LEAST_TOOL = 0.05, 0.4
"""Minimum force, N RMS, and minimum vibration of the tool, m/s^2 RMS, for a suspicion."""

NOISE = 0.1
"""Noise of both sensors that does not count as vibration, m/s^2 RMS."""

TURNS = 2
"""Minimum number of sign changes in a window: a hand's motion has fewer."""

SAME = 0.005
"""Maximum fraction of the tool's vibration that the handle does not explain, if the tool's sensor
picks up the handle. A handle that follows the tool lags behind it after the same high-pass, except
for a tone near 57 Hz, at which the force may sustain itself."""

SILENT_SHARE = 0.15
"""Ratio of the handle's acceleration to the tool's, and to the force over the moved mass, below
which the handle does not respond; the tool's sensor may respond to the force instead."""

TONAL, STRIDE = 0.1, 3e-3
"""Maximum fraction of a tone that its own past does not predict, and the prediction time, s."""

LASTING, GROWN = 0.5, 4.0
"""Ratio of the power of a window's second half to that of its first half below which the vibration
ends by itself; and ratio of a window's power to that of either of the two windows before it, above
which the vibration has just started, as after a tap."""

MUTED, QUIET = 0.03, 0.015
"""Duration without force, s, and its final part in which the tool's vibration is measured."""

ENDED = 0.05
"""Maximum fraction of the power that remains without force, apart from the handle's ringing, if
the force sustains the vibration."""

FORESEEN = 0.2
"""Time for which the handle's motion is predicted, s: longer than high-pass and grip ring."""

PAUSE, LONGEST_PAUSE = 0.25, 32.0
"""Minimum and maximum time from a suspicion without proof to the next, s; it doubles each time."""


class HowlingDetector:
    """Detection of tool vibration that is caused by the force, with a test without force.

    Parameters
    ----------
    rate : float
        Samples per second.
    supervisor : ResponseSupervisor
        Supervisor of a coil, with the samples and the expected motion of its handle.
    sections : ndarray, shape (n, 6)
        High-pass of the desired acceleration.
    mass : float
        Mass that the force moves, kg.

    Attributes
    ----------
    suspects : bool
        True while the force has to be zero, to test whether the vibration ends with it.
    proved : bool
        True once the vibration has ended with the force.
    """

    def __init__(
        self, rate: float, supervisor: ResponseSupervisor, sections: FloatArray, mass: float
    ) -> None:
        self._rate, self._mass, self._sections = rate, mass, sections
        self._trace = trace = supervisor.trace
        self._expected = supervisor.expected
        self._hop, self._length = max(1, round(HOP * rate)), max(6, round(WINDOW * rate))
        self._stride = max(1, round(STRIDE * rate))
        self._high_pass = SampleFilter(sections)
        trace.kept = max(trace.kept, 4 * self._length)
        self.reset()

    def reset(self) -> None:
        """Discard all samples and suspicions."""
        self._last_count = self._trace.count
        self._high_pass.reset()
        self._moved = np.zeros(self._length)
        self._rest: float | None = None
        self.suspects = self.proved = False
        self._since, self._pause, self._next = 0, 0.0, PAUSE
        self._gain = self._least = 0.0
        self._is_heard = False

    @property
    def left(self) -> int:
        """Number of samples until the next evaluation; not positive if it is due."""
        return self._last_count + self._hop - self._trace.count

    def update(self) -> None:
        """Evaluate the latest samples, if enough are stored."""
        trace = self._trace
        new = min(trace.count - self._last_count, trace.stored)
        if new < self._hop:
            return
        self._last_count = trace.count
        self._follow(new)
        self._pause -= new / self._rate
        if self.suspects:
            self._since += new
            if self._since >= MUTED * self._rate:
                self._decide()
        elif self._pause <= 0.0 and self._is_suspicious():
            self.suspects, self._since = True, 0

    def _follow(self, new: int) -> None:
        """Filter the handle's latest acceleration with the tool's high-pass."""
        moved = latest(self._trace, MEASURED, new)
        if self._rest is None:
            self._rest = float(moved[0])
        passed = [self._high_pass.process(value - self._rest) for value in moved.tolist()]
        self._moved = np.append(self._moved, passed)[-self._length :]

    def _is_suspicious(self) -> bool:
        """Return True if the tool's vibration may be caused by the force."""
        trace, length, moved = self._trace, self._length, self._moved
        force, tool = latest(trace, FORCE, length), latest(trace, DESIRED, length)
        power = _power(tool)
        if _power(force) < LEAST_FORCE**2 or power < LEAST_TOOL**2:
            return False
        half = length // 2
        beginning, ending = _power(tool[:half]), _power(tool[half:])
        lasting = ending / max(beginning, NOISE**2)
        turns = np.count_nonzero(tool[1:] * tool[:-1] < 0.0)
        before = min(_power(latest(trace, DESIRED, length, late * length)) for late in (1, 2))
        if lasting < LASTING or power > GROWN * max(before, NOISE**2) or turns < TURNS:
            return False
        now = latest(trace, DESIRED, length, 1)
        is_heard = _left(now, moved) < SAME + NOISE**2 / power
        if not (is_heard or self._is_deaf(force, power)):
            return False
        self._is_heard = is_heard
        pickup = self._pickup(length)
        self._gain = float(now @ pickup) / max(float(pickup @ pickup), NOISE**2)
        # Less remains anyway of a vibration that ends by itself.
        spans = MUTED * self._rate / half
        self._least = ENDED * ending * min(1.0, lasting) ** spans
        return True

    def _is_deaf(self, force: FloatArray, power: float) -> bool:
        """Return True if the handle's sensor responds neither to the force nor to the tool.

        While the sensor is saturated, or a sample is missing, this is unknown; then only a tone is
        suspicious, as tones do not occur by chance.
        """
        trace, moved = self._trace, _power(self._moved)
        unknown = (*trace.saturated, *trace.missing)
        if any(index >= trace.count - self._length for index in unknown):
            return self._is_tonal()
        answer = min(_power(force) / self._mass**2, power)
        return moved < SILENT_SHARE**2 * answer

    def _pickup(self, length: int) -> FloatArray:
        """Return the motion that the tool's sensor may pick up, up to the sample before the last.

        If the handle's sensor does not respond, this is the expected motion of the handle.
        """
        if self._is_heard:
            return self._moved[-length:]
        expected = self._expected(round(FORESEEN * self._rate)).tolist()
        passing = SampleFilter(self._sections)
        return np.array([passing.process(value) for value in expected])[-length:]

    def _is_tonal(self) -> bool:
        """Return True if the past predicts the tool's vibration, as for a tone."""
        length, step = self._length, self._stride
        past = [latest(self._trace, DESIRED, length, late) for late in (0, step, 2 * step)]
        return _left(past[0], *past[1:]) < TONAL

    def _decide(self) -> None:
        """End the time without force; if the vibration has ended, the force was its cause."""
        length = max(1, round(QUIET * self._rate))
        tool = latest(self._trace, DESIRED, length, 1)
        left = _power(tool - self._gain * self._pickup(length))
        self.proved = left < max(self._least, NOISE**2)
        self.suspects = False
        self._pause, self._next = self._next, min(2.0 * self._next, LONGEST_PAUSE)


def _power(signal: FloatArray) -> float:
    return float(signal @ signal) / len(signal)


def _left(signal: FloatArray, *causes: FloatArray) -> float:
    """Return the fraction of a signal's power that a sum of others does not explain."""
    basis = np.array(causes)
    normal = basis @ basis.T + 1e-12 * np.eye(len(basis))
    cross = basis @ signal
    explained = float(cross @ np.linalg.solve(normal, cross))
    return 1.0 - explained / max(float(signal @ signal), 1e-12)
