# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Controller of one coil: switching, supervision and gain, one sample at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.control.authority import Authority
from haptic_accel.core.control.controllers import CONTROLLERS, OWN_CONTROLLERS, Loop, granted_delay
from haptic_accel.core.control.controllers.interface import (
    NO_FORCE,
    Controller,
    ForeignController,
    replaced,
)
from haptic_accel.core.control.fallback import Fallback
from haptic_accel.core.control.filters import MOTION_SHARE, cancelling_sections, high_pass
from haptic_accel.core.model import ACTUATOR, ApproximateModel
from haptic_accel.core.outside import OutsideError, guard
from haptic_accel.core.parameters import Checked, ParameterError, one_line
from haptic_accel.core.tick import DYNAMIC, ActuatorGuard, CoilChannel, SampleFilter, Stage, Trace

LARGEST_GAIN = 4.0
"""Maximum gain: two doublings; beyond, strong textures mainly reach the actuator's limits."""

RAMP = 0.05
"""Duration of a change of the gain, s: no click is perceptible, as its spectrum is below 20 Hz."""

LISTENING = 0.5
"""Duration for which a new controller only receives both accelerations, s."""

FADING = 5e-3
"""Duration of the crossfade from one controller to the next, s."""

RESTING = 0.05
"""Time constant of the mean tool acceleration that initialises a new controller, s."""


def build_controller(name: str, loop: Loop, parameters: Checked | None = None) -> Controller:
    """Build a controller by its name.

    Parameters
    ----------
    name : str
        A key of `CONTROLLERS`.
    loop : Loop
        Rate, high-pass and plant of the control loop.
    parameters : optional
        Instance of the controller's parameters; default: its default values.

    Raises
    ------
    ParameterError
        The controller does not exist, or belongs to another package and cannot be built.
    """
    if name not in CONTROLLERS:
        raise ParameterError(f"controller = {name!r}: must be one of {', '.join(CONTROLLERS)}")
    controller = CONTROLLERS[name]
    own = parameters if parameters is not None else controller.Parameters()
    try:
        with guard(controller.__module__, passing=(ParameterError,)):
            return controller(own, loop)
    except OutsideError as error:
        raise OutsideError(f"controller = {name!r}: {error}") from None


def check_controller(name: str, rate: float, options: Mapping[str, Checked]) -> None:
    """Build another package's controller once, so that invalid parameters are rejected."""
    if name not in OWN_CONTROLLERS:
        build_controller(name, Loop(rate), options.get(name))


class Channel(CoilChannel):
    """Controller, supervision and estimated limits of one coil.

    Idle until `wake`: without force, counting or adaptation.

    Parameters
    ----------
    controller : str
        Name of the controller.
    loop : Loop
        Rate, high-pass and plant of the coil.
    options : mapping
        Parameters of controllers and of the actuator that differ from the defaults, by name.
    prepared : sequence of str
        Controllers to build in advance, so that `select` takes no time.
    gain : float
        Factor of the desired acceleration.
    authority : Authority
        Force fraction common to all channels; its owner updates and reports it.
    trace : Trace
        Samples for supervision and learning.

    Attributes
    ----------
    fallback : Fallback
    supervisor : ResponseSupervisor
        Comparison of the handle with its plant.
    failure : str
        Reason why `none` has to take over; empty if there is none.
    """

    def __init__(
        self,
        controller: str,
        loop: Loop,
        options: Mapping[str, Checked],
        prepared: Sequence[str],
        gain: float,
        authority: Authority,
        trace: Trace,
    ) -> None:
        self._options, self._loop, rate = options, loop, loop.rate
        self._sections = high_pass(loop.high_pass_frequency, rate)
        actuator = options.get(ACTUATOR, ActuatorParameters())
        approximate = options.get(DYNAMIC, ApproximateModel())
        assert isinstance(actuator, ActuatorParameters)
        assert isinstance(approximate, ApproximateModel)
        self._controllers: dict[str, Controller] = {}
        self._stages: dict[str, Stage] = {}
        self._build(controller)
        for name in prepared:
            with suppress(OutsideError):  # reported when the controller is selected
                self._build(name)
        self.fallback = Fallback(loop, approximate, authority, trace)
        self._ramp = max(1, round(RAMP * rate))
        limits = ActuatorGuard(actuator, rate)
        super().__init__(self._stages[controller], self.fallback, trace, limits)
        self.gain = self.gain_target = gain
        self.resting = -math.expm1(-1.0 / (RESTING * rate))
        self.listening, self.fading = round(LISTENING * rate), max(1, round(FADING * rate))
        self._waiting: Stage | None = None
        self.failure = ""
        self.supervisor = self.fallback.supervisor
        self.fallback.start(*self._judged)

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return (self._waiting or self.follower or self.active).name

    def select(self, name: str) -> None:
        """Change to another controller without a jump in force.

        During `LISTENING` the new controller only receives samples, until its filters have
        settled. It is then faded in over `FADING`. A running crossfade is completed before another
        controller starts. In the idle state, and while the gain is zero, the change is immediate,
        as it is imperceptible. A controller that was replaced because it was worse than no
        compensation is tried again when it is selected again.

        Raises
        ------
        ParameterError
            The controller does not exist, or its parameters are invalid.
        """
        self._build(name)
        if name == self.controller:
            if name == self.active.name:
                self.fallback.follow(*self._judged)
            return
        stage = self._stages[name]
        if self.asleep:
            self.active, self.follower, self._waiting = stage, None, None
            self.fallback.follow(*self._judged)
        elif self.gain == self.gain_target == 0.0:
            self._listen(self.active)  # no follower
            self._waiting = None
            self.take_over(stage)
            stage.rest = self.rest
        elif self.follower and self.listened > self.listening:
            self._waiting = stage
        else:
            self._listen(stage)

    def set_gain(self, gain: float) -> None:
        """Change the factor of the desired acceleration; immediately in the idle state."""
        self.gain_target, self.gain_left = gain, self._ramp
        self.gain_step = (gain - self.gain) / self._ramp
        if self.asleep:
            self.gain, self.gain_left = self.gain_target, 0

    def wake(self, tool_acceleration: float) -> None:
        """End the idle state; `tool_acceleration` is the tool's acceleration at rest, m/s^2."""
        self.asleep = False
        self.rest = self.active.rest = tool_acceleration

    def adapt(self) -> int:
        """Execute a part of the slow computations; return the samples left to the next part."""
        fallback, count = self.fallback, self.trace.count
        judged = count >= fallback.due and fallback.update(count)
        left, self.failure = fallback.due - count, ""
        for stage in filter(None, (self.active, self.follower)):
            controller = self._controllers[stage.name]
            try:
                left = min(left, controller.adapt() or 1)
            except Exception as error:  # a defect of this package's controllers
                reason = f"raised {type(error).__name__}: {one_line(error)}"
                self.failure = replaced(stage.name, reason)
            self.failure = self.failure or controller.failure
            if judged:
                controller.judged(fallback.supervisor.fitting, fallback.fraction)
        return 1 if self.follower else left

    def mute(self, muted: bool) -> None:
        """Compute no force while the device applies none, for example during an emergency stop.

        A controller that assumes that its force acts would learn that the handle does not respond,
        and would request several newtons as soon as the device applies forces again. Forces are
        then faded in over `FADING`; in the idle state there is nothing to fade.
        """
        if self.muted and not muted and self.asleep:
            self.share = 1.0
        self.muted = muted

    def freeze(self, frozen: bool) -> None:
        """Stop or resume the adaptation of all controllers."""
        for controller in self._controllers.values():
            controller.freeze(frozen)

    def reset(self) -> None:
        """Return to the initial state.

        The estimates of the actuator's heat and travel remain: a reset does not cool the coil. If
        the tick calls this because of a non-finite force, `failure` states that force.
        """
        self.failure = ""
        for stage in self._stages.values():
            if not math.isfinite(stage.own):
                self.failure, stage.own = replaced(stage.name, NO_FORCE.format(stage.own)), 0.0
            stage.reset()
        self.gain, self.gain_left = self.gain_target, 0
        self.rest, self.upright, self.asleep = 0.0, math.nan, True
        self.fallback.start(*self._judged)

    @property
    def warning(self) -> str:
        """Warnings of supervision and controller; empty if there are none."""
        controller = self._controllers[self.active.name]
        return ", ".join(filter(None, (self.fallback.warning, controller.warning)))

    def diagnostics(self) -> dict[str, str]:
        """Return values with units for diagnostics."""
        guard = self.guard
        return {
            "replaced by": self.fallback.substitute or "-",
            "force used (%)": f"{100 * self.fallback.used:.0f}",
            "saturated": str(guard.saturated),
            "limited by heat": str(guard.heated),
            "limited by travel": str(guard.cushioned),
            "heat (%)": f"{100 * guard.heat_share():.1f}",
            "travel (mm)": f"{1e3 * guard.travel:.2f}",
            **self._controllers[self.active.name].diagnostics(),
        }

    def _build(self, name: str) -> None:
        if name not in self._stages:
            loop = self._loop
            controller = build_controller(name, loop, self._options.get(name))
            cancelling = None
            if controller.reducible:
                corner = MOTION_SHARE * loop.high_pass_frequency
                sections = cancelling_sections(loop.plant.handle, corner, loop.rate)
                cancelling = SampleFilter(sections)
            if name not in OWN_CONTROLLERS:
                controller = ForeignController(name, controller, loop)
            self._controllers[name] = controller
            self._stages[name] = Stage(name, controller, SampleFilter(self._sections), cancelling)

    def _listen(self, stage: Stage) -> None:
        """Start a stage as the follower, unless it is already active."""
        if self.follower:
            self.follower.reset()
        self.follower = None if stage is self.active else stage
        self.listened = 0

    def take_over(self, stage: Stage) -> None:
        """Use another controller from now on, and start the waiting one."""
        self.active.reset()
        self.active, self.follower = stage, None
        self.fallback.follow(*self._judged)
        waiting, self._waiting = self._waiting, None
        if waiting:
            self._listen(waiting)

    @property
    def _judged(self) -> tuple[str, int]:
        """Name of the active controller, and its granted delay, in samples."""
        name = self.active.name
        return name, granted_delay(name, self._options, self._loop.rate)
