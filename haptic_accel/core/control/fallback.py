# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reduction or replacement of a controller that is worse than no compensation."""

from __future__ import annotations

import math

import numpy as np

from haptic_accel.core.control.authority import Authority
from haptic_accel.core.control.controllers import CONTROLLERS
from haptic_accel.core.control.controllers.fixed import DynamicController
from haptic_accel.core.control.controllers.interface import Loop
from haptic_accel.core.control.estimation import ResponseEstimator, latest
from haptic_accel.core.control.supervision import HIGHEST_SHARE, ResponseSupervisor
from haptic_accel.core.model import ApproximateModel, ComplexArray, FloatArray
from haptic_accel.core.tick import DESIRED, DRIVE, DYNAMIC, MEASURED, Substitution, Trace

NO_CONTROLLER = "none"
"""Name of the substitute without force."""

ERROR_MEMORY = 0.5
"""Time constant of the running error, s."""

LOWEST = 9.0
"""Lower frequency limit of the error, Hz; below it the handle moves with the hand."""

LEAST_DESIRED = 0.2
"""Desired acceleration below which the error is not evaluated, m/s^2 RMS: ten times the arm's own
motion and noise."""

WORSE, WORSE_FOR = 1.15, 0.45
"""Ratio of running error to error without force above which a controller is replaced, and duration
of this excess, s. The paper's conditions stay below: constant gain on its rig has 90 to 108 % on
vinyl, and 113 % in the worst half second."""

UNDESCRIBED_WORSE, UNDESCRIBED_WORSE_FOR = 1.0, 0.4
"""The same limits for a handle that deviates from its model; replacement is then faster."""

BETTER = 0.7
"""Ratio of predicted error to error without force below which a controller may be tried."""

PAUSE = 1.0
"""Time for which a smaller error must be predicted before a controller is tried again, s of
excitation. After the same time without force, a fraction of its force is tried. The time doubles
after each failed trial, up to `LONGEST_PAUSE`."""

LEAST_PART, LARGEST_PART = 0.05, 0.25
"""Bounds of the fraction of the force that is tried while no substitute is active: without force,
nothing can be learnt about the handle."""

FADING = 5e-3
"""Duration of the crossfade to a substitute, s."""

LONGEST_PAUSE = 32.0
"""Upper bound of the doubled pause, s of excitation. A trial also fails if a device rejects the
force briefly, for example because of a second sender. A good controller must then return."""

TRIAL = 1.0
"""Duration of the gradual return, s, long enough to detect a wrong force while it is small."""

TRIAL_WORSE, TRIAL_WORSE_FOR = 1.02, 0.1
"""Ratio of running error to error without force that ends a trial, and duration of this excess, s.
Without force the handle moves slightly with the arm: 1.01 on the paper's rig."""

FILTER_SETTLING = 0.1
"""Time for which the filters of `dynamic` settle before it is faded in, s: its poles are at 9 Hz
and above."""

TURNS = 3
"""Period of each part of an evaluation, in samples, so that no two parts are computed in the same
sample."""


class _Prospect(ResponseEstimator):
    """Comparison of the predicted effect of a force with the desired acceleration."""

    def _has_gaps(self, end: int) -> bool:
        return False  # both signals are known


class Fallback(Substitution):
    """Reduce or replace the force of a controller that is worse than no compensation.

    Controllers that are designed for the identified handle are reduced: see `Authority`. Those of
    the paper are used unchanged or replaced, as follows.

    The handle's error is compared with the error without force, from spectra with exponential
    forgetting. If the error is larger for most of a second, the force is faded out. The force of
    `dynamic` is faded in if its predicted error is smaller than without force. The prediction is
    the model's response, times the measured ratio of handle to model response. The replaced
    controller still receives all samples and may learn from them. It is tried again when its
    predicted error has been small enough for `PAUSE`. After the same time without any force, the
    fraction of its force with the smallest predicted error is applied, to allow learning. A trial
    force grows slowly, and is removed at once if it increases the error; the pause then doubles.

    Parameters
    ----------
    loop : Loop
    dynamic : ApproximateModel
        Parameters of the controller `dynamic`.
    authority : Authority
        Common to all axes; its owner updates and reports it.
    trace : Trace
        Signals of each sample: desired acceleration, force sent, force requested by the controller
        (`drive`), and acceleration measured at the previous sample.

    Attributes
    ----------
    supervisor : ResponseSupervisor
    due : int
        Count of the trace at which `update` next has something to do.
    substitute : str
        Name of the substitute; empty if there is none.
    """

    authority: Authority

    def __init__(
        self, loop: Loop, dynamic: ApproximateModel, authority: Authority, trace: Trace
    ) -> None:
        step = 1.0 / max(1, round(FADING * loop.rate))
        settling = round(FILTER_SETTLING * loop.rate)
        super().__init__(DynamicController(dynamic, loop), step, settling)
        self.trace, self.authority = trace, authority
        self.supervisor = ResponseSupervisor(loop.plant, loop.rate, trace)
        self._latency = loop.latency
        self._tracking = ResponseEstimator(trace, loop.rate, ERROR_MEMORY)
        self._tracking.read = self._tracked_pairs
        self._prospect = _Prospect(trace, loop.rate, ERROR_MEMORY)
        self._prospect.read = self._prospects
        lines = self._tracking.frequency
        self._counted = ((lines >= LOWEST) & (lines <= HIGHEST_SHARE * loop.rate)).astype(float)
        self._tracked = self._dynamic_response(loop)
        self.start(NO_CONTROLLER, 1)

    @property
    def warning(self) -> str:
        """Description of the deviating bands and the substitute; empty if there is none."""
        replaced = ""
        if self.substitute:
            took_over = "a fraction is tried" if self.probing else f"{self.substitute} took over"
            replaced = f"{self._name} is worse than no compensation: {took_over}"
        elif self._on_trial:
            replaced = f"{self._name} was worse than no compensation: it is tried again"
        return ", ".join(filter(None, (self.supervisor.warning, replaced)))

    @property
    def fraction(self) -> float:
        """Fraction of the controller's force that does not increase the error."""
        return float(self.share * self.authority.fraction)

    @property
    def used(self) -> float:
        """Fraction of the controller's force in use: less than `fraction` after silence."""
        return float(self.share * self.authority.used)

    def start(self, name: str, granted_delay: int) -> None:
        """Return to the initial state, for a controller and its additional delay."""
        self.supervisor.reset()
        self.share, self.gain = 1.0, 0.0
        self.requested = 0.0
        self.running = 0  # number of samples that `dynamic` has processed since its start
        self.follow(name, granted_delay)

    def follow(self, name: str, granted_delay: int) -> None:
        """Evaluate another controller, or restart for the same; fade out any substitute."""
        self._name, self.substitute = name, ""
        self.reducible = CONTROLLERS[name].reducible
        self.pace = self.step
        self._trial = math.inf  # time since the last return, s
        self._granted = granted_delay
        self._delay = self._latency + granted_delay + 1
        self.trace.kept = max(self.trace.kept, 2 * len(self._counted) + self._delay)
        self.authority.follow(self._delay)
        # Counts before which the controller had no desired acceleration, and no requested force.
        self._followed = self._replaced = self.due = self.trace.count
        self._pause = PAUSE
        self.probing = False
        self.part = 0.0
        self._worse = self._better = self._idle = 0.0
        self._error = 0.0  # ratio to error without force
        self._tracking.reset()

    def update(self, count: int) -> bool:
        """Execute a part of slow computations; return True after a new result.

        Call it at a count of the trace from `due` on.
        """
        turn, parts = count % TURNS, self._parts
        done = turn < len(parts) and parts[turn].update()
        if done and turn:
            self._reconsider() if turn == 2 else self._judge()
            parts = self._parts
        dues = [count + each.left for each in parts]
        self.due = min([due + (place - due) % TURNS for place, due in enumerate(dues)])
        return done and turn == 0

    @property
    def _parts(self) -> tuple[ResponseSupervisor | ResponseEstimator, ...]:
        """Active evaluations, in the order of their turns."""
        compared = self._tracking, self._prospect
        may_be_replaced = not self.reducible and self._name != NO_CONTROLLER
        return self.supervisor, *compared[: may_be_replaced * (1 + bool(self.substitute))]

    def _tracked_pairs(self, length: int) -> tuple[FloatArray, FloatArray]:
        # `dynamic` lags by one sample, regardless of the controller's granted delay.
        later = max(0, self._granted - 1) if self.substitute == DYNAMIC else 0
        return self._desired(length, self._delay - later), latest(self.trace, MEASURED, length)

    def _prospects(self, length: int) -> tuple[FloatArray, FloatArray]:
        expected = self.supervisor.expected(length, DRIVE, self._replaced)
        return expected, self._desired(length, self._delay)

    def _desired(self, length: int, late: int) -> FloatArray:
        return latest(self.trace, DESIRED, length, late, self._followed)

    @property
    def _on_trial(self) -> bool:
        return self.probing or self._trial < 2.0 * TRIAL

    def _judge(self) -> None:
        """Replace the controller, or its substitute, if it is worse than no force."""
        tracking = self._tracking
        power = self._power(tracking.excitation)
        if power < LEAST_DESIRED**2 or (self.substitute == NO_CONTROLLER and not self.probing):
            return
        difference = tracking.output - 2.0 * tracking.cross.real + tracking.excitation
        self._error = math.sqrt(max(0.0, self._power(difference)) / power)
        limit, time = WORSE, WORSE_FOR
        if self._on_trial:
            limit, time = TRIAL_WORSE, TRIAL_WORSE_FOR
        elif not self.supervisor.described:
            limit, time = UNDESCRIBED_WORSE, UNDESCRIBED_WORSE_FOR
        self._trial += tracking.interval
        self._worse = self._worse + tracking.interval if self._error > limit else 0.0
        if self._worse >= time:
            self._replace()

    def _replace(self) -> None:
        """Replace the controller by `dynamic` or by no force, or its substitute by no force."""
        if self._on_trial:
            self._pause = min(2.0 * self._pause, LONGEST_PAUSE)
        self._worse = self._idle = 0.0
        self.pace = self.step
        self.probing = False
        if self.substitute:
            self.substitute = NO_CONTROLLER
            return
        rather = self._name != DYNAMIC and self._dynamic_error() < BETTER
        self.substitute = DYNAMIC if rather else NO_CONTROLLER
        self._tracking.reset()
        self.dynamic.reset()
        self.running = 0
        self._better = 0.0
        self._replaced = self.trace.count
        self._prospect.reset()

    def _reconsider(self) -> None:
        """Return to the controller once it has been predicted to be better for long enough."""
        prospect, ratio = self._prospect, self.supervisor.ratio
        power = self._power(prospect.output)
        if power < LEAST_DESIRED**2:
            return
        shared = (ratio.conj() * prospect.cross).real
        expected = np.abs(ratio) ** 2 * prospect.excitation
        error = expected - 2.0 * shared + prospect.output
        # Fraction of the force with the smallest predicted error.
        best = self._power(shared) / max(self._power(expected), 1e-12)
        self.part = min(max(best, LEAST_PART), LARGEST_PART)
        foreseen = math.sqrt(max(0.0, self._power(error)) / power)
        present = 1.0 if self.substitute == NO_CONTROLLER else self._error
        better = foreseen < min(BETTER, present)
        self._better = self._better + prospect.interval if better else 0.0
        self._idle += prospect.interval
        if self._better >= self._pause:
            self._trial = 0.0
            self._try("")
        elif self.substitute == NO_CONTROLLER and self._idle >= self._pause and not self.probing:
            self._try(NO_CONTROLLER)

    def _try(self, substitute: str) -> None:
        """Start to increase the controller's share of the force, with or without a substitute."""
        self.substitute = substitute
        self.probing = bool(substitute)
        self.pace = self.step * FADING / TRIAL
        self._worse = 0.0
        self._tracking.reset()

    def _dynamic_error(self) -> float:
        """Return the predicted error of `dynamic` over the error without force."""
        desired = self._tracking.excitation
        error = np.abs(self.supervisor.ratio * self._tracked - 1.0) ** 2
        return math.sqrt(self._power(error * desired) / self._power(desired))

    def _dynamic_response(self, loop: Loop) -> ComplexArray:
        """Return the model's acceleration with `dynamic` over the delayed desired acceleration.

        The delay is the latency and one sample. Complex values on the lines of the estimates; 1 is
        ideal.
        """
        lines = self._tracking.frequency
        length = 2 * len(lines) - 2
        force = [self.dynamic.force(float(not index), math.nan) for index in range(length)]
        self.dynamic.reset()
        response = np.zeros(len(lines), dtype=np.complex128)
        turned = 2j * np.pi * lines[1:] * (self._latency + 1) / loop.rate
        response[1:] = loop.plant.response(lines[1:], loop.rate) * np.exp(turned)
        return response * np.fft.rfft(force)

    def _power(self, density: FloatArray) -> float:
        """Return the power of a density in the evaluated lines."""
        return float(self._counted @ density) * float(self._tracking.frequency[1])
