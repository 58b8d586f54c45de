# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Detection of a force that sustains itself, as the tool's accelerometer hears the handle."""

from __future__ import annotations

import numpy as np

from haptic_accel.core.control.response_estimation import latest
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.model import FloatArray
from haptic_accel.core.tick import DESIRED, FORCE, MEASURED, SampleFilter

HEARS = (
    "the tool's sensor hears the handle: its vibration ends with the force; none took over; check"
    " the cables and the place of both sensors"
)
"""Message on a force that sustains itself."""

HOP, WINDOW = 8e-3, 24e-3
"""Time from one evaluation to the next, and its length, s."""

LEAST_FORCE, LEAST_TOOL = 0.05, 0.4
"""Force, N RMS, and vibration of the tool, m/s^2 RMS, below which nothing is suspected."""

NOISE = 0.1
"""Noise of both sensors that is no vibration, m/s^2 RMS."""

TURNS = 2
"""Least number of changes of the sign in a window: a hand's motion has fewer."""

SAME = 0.005
"""Largest share of the tool's vibration that is not the handle's, where the tool's sensor hears
the handle. One that follows the tool is later, behind the same high-pass, but for a tone near
57 Hz, at which the force may sustain itself."""

SILENT_SHARE = 0.15
"""Handle's acceleration relative to the tool's, and to the force by the mass that it moves, below
which the handle does not answer: it may be the tool's sensor that does."""

TONAL, STRIDE = 0.1, 3e-3
"""Share of a tone that its own past does not predict, at most, and how far ahead, s."""

LASTING, GROWN = 0.5, 4.0
"""Ratio of the power of a window's second half to that of its first, below which the vibration
ends by itself; and of a window to each of the two before, above which it has just begun, as a tap
does."""

MUTED, QUIET = 0.03, 0.015
"""Time without force, s, and its end in which the tool is listened to."""

ENDED = 0.05
"""Share of the power that is left without force, beside what the handle rings, where the force
sustains the vibration."""

FORESEEN = 0.2
"""Time for which the handle's motion is predicted, s: longer than high-pass and grip ring."""

PAUSE, LONGEST_PAUSE = 0.25, 32.0
"""Time after a suspicion without proof until the next one, s; it doubles each time."""


class HowlingDetector:
    """Suspicion that the tool's vibration is caused by the force, and its proof.

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
        True while the force is to be zero, to see whether the vibration ends with it.
    proved : bool
        True once it has ended.
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
        """Forget all samples and suspicions."""
        self._taken = self._trace.count
        self._high_pass.reset()
        self._moved = np.zeros(self._length)
        self._rest: float | None = None
        self.suspects = self.proved = False
        self._since, self._pause, self._next = 0, 0.0, PAUSE
        self._gain = self._least = 0.0
        self._is_heard = False

    @property
    def left(self) -> int:
        """Number of samples until `update` has something to do; not positive if it is due."""
        return self._taken + self._hop - self._trace.count

    def update(self) -> None:
        """Evaluate the latest samples, if enough are stored."""
        trace = self._trace
        new = min(trace.count - self._taken, trace.stored)
        if new < self._hop:
            return
        self._taken = trace.count
        self._follow(new)
        self._pause -= new / self._rate
        if self.suspects:
            self._since += new
            if self._since >= MUTED * self._rate:
                self._decide()
        elif self._pause <= 0.0 and self._is_suspicious():
            self.suspects, self._since = True, 0

    def _follow(self, new: int) -> None:
        """Pass the handle's latest acceleration through the high-pass of the tool's."""
        moved = latest(self._trace, MEASURED, new)
        if self._rest is None:
            self._rest = float(moved[0])
        passed = [self._high_pass.process(value - self._rest) for value in moved.tolist()]
        self._moved = np.append(self._moved, passed)[-self._length :]

    def _is_suspicious(self) -> bool:
        """Return whether the tool's vibration may be caused by the force."""
        trace, length, moved = self._trace, self._length, self._moved
        force, tool = latest(trace, FORCE, length), latest(trace, DESIRED, length)
        power = _power(tool)
        if _power(force) < LEAST_FORCE**2 or power < LEAST_TOOL**2:
            return False
        half = length // 2
        begun, ending = _power(tool[:half]), _power(tool[half:])
        lasting = ending / max(begun, NOISE**2)
        turns = np.count_nonzero(tool[1:] * tool[:-1] < 0.0)
        before = min(_power(latest(trace, DESIRED, length, late * length)) for late in (1, 2))
        if lasting < LASTING or power > GROWN * max(before, NOISE**2) or turns < TURNS:
            return False
        now = latest(trace, DESIRED, length, 1)
        is_heard = _left(now, moved) < SAME + NOISE**2 / power
        if not (is_heard or self._is_deaf(force, power)):
            return False
        self._is_heard = is_heard
        caused = self._caused(length)
        self._gain = float(now @ caused) / max(float(caused @ caused), NOISE**2)
        # Of a vibration that ends by itself less is left anyway.
        spans = MUTED * self._rate / half
        self._least = ENDED * ending * min(1.0, lasting) ** spans
        return True

    def _is_deaf(self, force: FloatArray, power: float) -> bool:
        """Return whether the handle's sensor answers neither a force nor the tool.

        At its range, or without a sample, it is unknown; then only a tone is suspicious, as there
        are none by chance.
        """
        trace, moved = self._trace, _power(self._moved)
        unknown = (*trace.saturated, *trace.missing)
        if any(index >= trace.count - self._length for index in unknown):
            return self._is_tonal()
        answer = min(_power(force) / self._mass**2, power)
        return moved < SILENT_SHARE**2 * answer

    def _caused(self, length: int) -> FloatArray:
        """Return the motion that the tool's sensor may hear, of the latest samples but the last.

        Where the handle's sensor does not answer, it is what is expected of the handle.
        """
        if self._is_heard:
            return self._moved[-length:]
        expected = self._expected(round(FORESEEN * self._rate)).tolist()
        passing = SampleFilter(self._sections)
        return np.array([passing.process(value) for value in expected])[-length:]

    def _is_tonal(self) -> bool:
        """Return whether the tool's vibration follows from its own past, as a tone does."""
        length, step = self._length, self._stride
        past = [latest(self._trace, DESIRED, length, late) for late in (0, step, 2 * step)]
        return _left(past[0], *past[1:]) < TONAL

    def _decide(self) -> None:
        """End the time without force: the vibration has ended with it, or goes on."""
        length = max(1, round(QUIET * self._rate))
        tool = latest(self._trace, DESIRED, length, 1)
        left = _power(tool - self._gain * self._caused(length))
        self.proved = left < max(self._least, NOISE**2)
        self.suspects = False
        self._pause, self._next = self._next, min(2.0 * self._next, LONGEST_PAUSE)


def _power(signal: FloatArray) -> float:
    return float(signal @ signal) / len(signal)


def _left(signal: FloatArray, *causes: FloatArray) -> float:
    """Return the share of a signal's power that a sum of others does not explain."""
    basis = np.array(causes)
    normal = basis @ basis.T + 1e-12 * np.eye(len(basis))
    cross = basis @ signal
    explained = float(cross @ np.linalg.solve(normal, cross))
    return 1.0 - explained / max(float(signal @ signal), 1e-12)
