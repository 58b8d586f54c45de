# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Controller of one coil: its changes, supervision and gain, one sample at a time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.control.arm_cancellation import ArmCancellation
from haptic_accel.core.control.authority import Authority
from haptic_accel.core.control.controllers import (
    CONTROLLERS,
    OWN_CONTROLLERS,
    Controller,
    Loop,
    granted_delay,
)
from haptic_accel.core.control.fallback import DYNAMIC, Fallback
from haptic_accel.core.control.filters import MOTION_SHARE, SampleFilter, high_pass
from haptic_accel.core.control.gain import Gain
from haptic_accel.core.control.supervision import ResponseSupervisor
from haptic_accel.core.model import ACTUATOR, ApproximateModel
from haptic_accel.core.outside import OutsideError, guard
from haptic_accel.core.parameters import Checked, ParameterError
from haptic_accel.core.tick import ActuatorGuard, Trace

LISTENING = 0.5
"""Time for which a new controller only receives both accelerations, s."""

FADING = 5e-3
"""Duration of the crossfade from one controller to the next, s."""

RESTING = 0.05
"""Time constant of the mean tool acceleration with which a new controller starts, s."""


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
        The controller does not exist, or is another package's and cannot be built.
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
    """Build a controller of another package once, so that it refuses what is wrong."""
    if name not in OWN_CONTROLLERS:
        build_controller(name, Loop(rate), options.get(name))


class Channel:
    """Controller, supervision and estimated limits of one coil.

    Idle until `wake`, without force, count or adaptation.

    Parameters
    ----------
    controller : str
        Name of the controller.
    loop : Loop
        Rate, high-pass and plant of the coil.
    options : mapping
        Parameters that differ from the defaults: of controllers and of the actuator, by name.
    prepared : sequence of str
        Controllers to build in advance, so that `select` takes no time.
    gain : float
        Factor of the desired acceleration.
    authority : Authority
        Common to all channels; its owner updates and reports it.
    trace : Trace
        What supervision and learning are to see.

    Attributes
    ----------
    guard : ActuatorGuard
    trace : Trace
    asleep : bool
        True in the idle state.
    is_reducible : bool
        True if a fraction of the active controller's force can be used.
    withheld : int
        Number of forces that were not computed, or faded in, because the device applied none.
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
        self._gain = Gain(gain, rate)
        actuator = options.get(ACTUATOR, ActuatorParameters())
        approximate = options.get(DYNAMIC, ApproximateModel())
        assert isinstance(actuator, ActuatorParameters)
        assert isinstance(approximate, ApproximateModel)
        self.guard = ActuatorGuard(actuator, rate)
        self._built: dict[str, _Stage] = {}
        self._build(controller)
        for name in prepared:
            with suppress(OutsideError):  # said when the controller is selected
                self._build(name)
        self._active = self._built[controller]
        self._fallback = Fallback(loop, approximate, authority, trace)
        self.trace = trace
        self._start_judging()
        self._follower: _Stage | None = None
        self._waiting: _Stage | None = None
        self._listened = 0
        self._resting = -math.expm1(-1.0 / (RESTING * rate))
        self._rest = 0.0
        self._listening, self._fading = round(LISTENING * rate), max(1, round(FADING * rate))
        self.withheld = 0
        self._muted, self._share = False, 1.0
        self._fall_asleep()

    @property
    def supervisor(self) -> ResponseSupervisor:
        """Comparison of the handle with its plant."""
        return self._fallback.supervisor

    @property
    def active(self) -> str:
        """Name of the controller whose force is used, also while another one is prepared."""
        return self._active.name

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return (self._waiting or self._follower or self._active).name

    def select(self, name: str) -> None:
        """Change to another controller without a jump in force.

        For `LISTENING` the new controller only receives samples, until its filters have settled.
        It is then faded in over `FADING`. A running crossfade is completed before another
        controller starts. In the idle state, and while the gain is zero, the change is immediate:
        nothing is felt of it. A controller that was
        replaced because it was worse than no compensation is tried again when it is selected
        again.

        Raises
        ------
        ParameterError
            The controller does not exist, or its parameters are invalid.
        """
        self._build(name)
        if name == self.controller:
            if name == self._active.name:
                self._judge_anew()
            return
        if self.asleep:
            self._active, self._follower, self._waiting = self._built[name], None, None
            self._judge_anew()
        elif self._gain.is_silent:
            self._listen(self._active)  # to nobody
            self._waiting = None
            self._take_over(self._built[name])
            self._active.begin(self._rest)
        elif self._follower and self._listened > self._listening:
            self._waiting = self._built[name]
        else:
            self._listen(self._built[name])

    @property
    def gain(self) -> float:
        """Factor of the desired acceleration of the last sample."""
        return self._gain.value

    def set_gain(self, gain: float) -> None:
        """Change the factor of the desired acceleration; in the idle state at once."""
        self._gain.change(gain)
        if self.asleep:
            self._gain.settle()

    def wake(self, tool_acceleration: float) -> None:
        """End the idle state; `tool_acceleration` is that of the tool at rest, m/s^2."""
        self.asleep = False
        self._rest = tool_acceleration
        self._active.begin(tool_acceleration)

    def requested(self, tool: float, measured: float, pushed: float) -> tuple[float, float]:
        """Return desired acceleration and force before the actuator's limits; then `settle`.

        Parameters
        ----------
        tool : float
            Plausible tool acceleration, m/s^2.
        measured : float
            Handle acceleration of the previous sample, m/s^2; NaN if missing, infinite if
            saturated.
        pushed : float
            Part of the arm's force on the handle that is to be cancelled, N.
        """
        desired, force = self._mixed(tool, measured, pushed)
        if not (math.isfinite(desired) and math.isfinite(force)):
            # An unstable controller: filters with an infinite state never recover.
            self.reset()
            desired = force = 0.0
        return desired, self._audible(self._fallback.force(desired, force))

    def settle(self, desired: float, measured: float, force: float) -> None:
        """Finish a sample with the force that is really sent.

        Parameters
        ----------
        desired, measured : float
            Desired and measured acceleration of `requested`.
        force : float
            Force within the actuator's limits, N.
        """
        # The handle answers neither to that part of the arm's force nor to what cancels it.
        force -= self._share * self._fallback.used * self._active.cancelling
        self._active.applied(force, self._gain.value)
        if self._follower:
            self._follower.applied(force, self._gain.value)
        self.trace.push(desired, measured, force, self._fallback.requested)

    def adapt(self) -> int:
        """Execute a part of the slow computations; return the number of samples to the next."""
        fallback = self._fallback
        judged = fallback.update()
        left = fallback.left
        for stage in filter(None, (self._active, self._follower)):
            left = min(left, stage.controller.adapt() or 1)
            if judged:
                stage.controller.judged(fallback.supervisor.fitting, fallback.fraction)
        return 1 if self._follower else left

    @property
    def is_supervising(self) -> bool:
        """True in the samples in which the supervision has its turn."""
        return self._fallback.is_supervising

    def mute(self, muted: bool) -> None:
        """Compute no force while the device applies none, for example during an emergency stop.

        A controller that took its own force for the one that acts would learn that the handle does
        not answer, and would push with newtons as soon as the device applies forces again. They
        are faded in over `FADING`; in the idle state there is nothing to fade.
        """
        if self._muted and not muted and self.asleep:
            self._share = 1.0
        self._muted = muted

    def freeze(self, frozen: bool) -> None:
        """Stop or resume the adaptation of all controllers."""
        for stage in self._built.values():
            stage.controller.freeze(frozen)

    def reset(self) -> None:
        """Return to the initial state.

        The estimates of the actuator's heat and travel remain: a reset does not cool the coil.
        """
        for stage in self._built.values():
            stage.reset()
        self._gain.settle()
        self._rest = 0.0
        self._start_judging()
        self._fall_asleep()

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return a warning, or an empty string, and values with units for diagnostics."""
        guard = self.guard
        controller = self._active.controller
        return ", ".join(filter(None, (self._fallback.warning, controller.warning))), {
            "replaced by": self._fallback.substitute or "-",
            "force used (%)": f"{100 * self._fallback.used:.0f}",
            "saturated": str(guard.saturated),
            "limited by heat": str(guard.heated),
            "limited by travel": str(guard.cushioned),
            "heat (%)": f"{100 * guard.heat_share():.1f}",
            "travel (mm)": f"{1e3 * guard.travel:.2f}",
            **controller.diagnostics(),
        }

    def _build(self, name: str) -> None:
        if name not in self._built:
            loop = self._loop
            controller = build_controller(name, loop, self._options.get(name))
            cancellation = None
            if controller.reducible:
                corner = MOTION_SHARE * loop.high_pass_frequency
                cancellation = ArmCancellation(loop.plant.handle, corner, loop.rate)
            self._built[name] = _Stage(
                name, SampleFilter(self._sections), controller, cancellation
            )

    def _fall_asleep(self) -> None:
        self.asleep = True
        self._upright = math.nan  # mean handle acceleration, mostly gravity, m/s^2

    def _mixed(self, tool: float, measured: float, pushed: float) -> tuple[float, float]:
        """Return desired acceleration and force, crossfaded during a change of controller."""
        gain = self._gain.advance()
        measured = self._unscaled(measured)
        desired, force = self._active.process(tool, measured, gain, pushed)
        self._rest += self._resting * (tool - self._rest)
        if self._follower is None:
            return desired, force
        if not self._listened:
            self._follower.begin(self._rest)
        following = self._follower.process(tool, measured, gain, pushed)
        self._listened += 1
        share = (self._listened - self._listening) / self._fading
        if share >= 1.0:
            self._take_over(self._follower)
            return following
        return desired, force + max(0.0, share) * (following[1] - force)

    def _unscaled(self, measured: float) -> float:
        """Return the handle's acceleration as it would be at a gain of 1; NaN if unknown.

        Controllers compute the force for a gain of 1, so that a change of the gain is no
        excitation for them: its product with the desired acceleration has slow components, which
        an inverse follows up to the actuator's stops.
        """
        if math.isfinite(measured):
            if math.isnan(self._upright):
                self._upright = measured
            self._upright += self._resting * (measured - self._upright)
        if self._gain.value == 1.0 and not self._gain.is_changing:
            return measured
        if self._gain.value == 0.0 or self._gain.is_changing:
            return math.nan
        return self._upright + (measured - self._upright) / self._gain.value

    def _audible(self, force: float) -> float:
        """Return the force, none while muted, and a growing share afterwards."""
        if self._muted:
            self._share = 0.0
        elif self._share < 1.0:
            self._share = min(1.0, self._share + 1.0 / self._fading)
        self.withheld += self._share < 1.0
        return self._share * force

    def _listen(self, stage: _Stage) -> None:
        """Prepare the next stage; none if it is already in use."""
        if self._follower:
            self._follower.reset()
        self._follower = None if stage is self._active else stage
        self._listened = 0

    def _take_over(self, stage: _Stage) -> None:
        self._active.reset()
        self._active, self._follower = stage, None
        self._judge_anew()
        waiting, self._waiting = self._waiting, None
        if waiting:
            self._listen(waiting)

    def _start_judging(self) -> None:
        name = self._active.name
        self.is_reducible = CONTROLLERS[name].reducible
        self._fallback.start(name, granted_delay(name, self._options, self._loop.rate))

    def _judge_anew(self) -> None:
        name = self._active.name
        self.is_reducible = CONTROLLERS[name].reducible
        self._fallback.follow(name, granted_delay(name, self._options, self._loop.rate))


class _Stage:
    """Controller with its own high-pass, both started at the same time.

    To a filter with zero state, an earlier constant acceleration is a step. An inverse, which
    extends the high-pass to far lower frequencies, responds to a step with newtons for seconds.

    Attributes
    ----------
    cancelling : float
        Part of the last force that cancels a part of the arm's, N.
    """

    def __init__(
        self,
        name: str,
        high_pass: SampleFilter,
        controller: Controller,
        cancellation: ArmCancellation | None,
    ) -> None:
        self.name = name
        self.controller = controller
        self._high_pass, self._cancellation = high_pass, cancellation
        self._rest = self._force = self.cancelling = 0.0

    def begin(self, tool_acceleration: float) -> None:
        """Initialize with the tool's acceleration at rest, mostly gravity."""
        self._rest = tool_acceleration

    def process(
        self, tool_acceleration: float, measured: float, gain: float, pushed: float
    ) -> tuple[float, float]:
        """Return the desired acceleration and the controller's force, times the gain.

        The force that cancels a part of the arm's belongs to no desired acceleration: a gain above
        1 does not increase it. A smaller one reduces it, so that a gain of 0 leaves no force.

        Parameters
        ----------
        tool_acceleration : float
            Tool acceleration, m/s^2.
        measured : float
            Handle acceleration as it would be at a gain of 1, m/s^2.
        gain : float
        pushed : float
            Part of the arm's force on the handle that is to be cancelled, N.
        """
        desired = self._high_pass.process(tool_acceleration - self._rest)
        self._force = self.controller.force(desired, measured)
        force = gain * self._force
        if self._cancellation:
            self.cancelling = min(1.0, gain) * self._cancellation.process(pushed)
            force += self.cancelling
        return gain * desired, force

    def applied(self, force: float, gain: float) -> None:
        """Pass the force that drives the handle to the controller, as for a gain of 1."""
        self.controller.applied(force / gain if gain else self._force)

    def reset(self) -> None:
        """Return to the state for zero past input."""
        self._rest = self.cancelling = 0.0
        self._high_pass.reset()
        self.controller.reset()
        if self._cancellation:
            self._cancellation.reset()
