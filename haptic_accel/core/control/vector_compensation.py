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
"""Compensation of a handle with three coils."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

from haptic_accel.core.actuator.guard import scaled_within
from haptic_accel.core.actuator.travel import LARGEST_ACCELERATION
from haptic_accel.core.axes import ALL_AXES, NAMES
from haptic_accel.core.control.alignment import Alignment
from haptic_accel.core.control.authority import Authority
from haptic_accel.core.control.compensation import (
    AT_RANGE,
    FULL,
    PER_AXIS,
    PLANT,
    Compensation,
    CompensationParameters,
)
from haptic_accel.core.control.controllers import CONTROLLERS, granted_delay
from haptic_accel.core.control.decoupling import (
    VectorConvolution,
    full_decoupling,
    static_decoupling,
)
from haptic_accel.core.control.filters import SampleFilter, high_pass
from haptic_accel.core.control.reduction_switch import ReductionSwitch
from haptic_accel.core.handle.matrix_plant import MatrixPlant
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked
from haptic_accel.core.reduction import NO_REDUCTION
from haptic_accel.core.sampling import LATENCY

MISSING: Vector = (math.nan, math.nan, math.nan)
SATURATED: Vector = (math.inf, math.inf, math.inf)
"""Handle acceleration that is missing, or at the sensor's limits in any axis."""


class VectorCompensation:
    """Compensation for a handle with three coils, one sample at a time.

    Tool and handle acceleration are decoupled, see `core.control.decoupling`. Each coil then has a
    compensation of its own, which sees the coil's plant alone: with controller, supervision and
    learning. The limits are common: where a coil reaches its peak force, its heat or its travel,
    the whole force is scaled and keeps its direction. Only a coil that must be braked before its
    stop leaves it. As for one axis, all is idle until a sample differs from the first one.

    With a reduction, the compensation of the coil along z receives the reduced tool acceleration,
    and the other coils have no force. Without their force, a decoupled axis moves by none, and the
    one of z as with a single coil: supervision and learning go on.

    Parameters
    ----------
    parameters : CompensationParameters
    rate : float
        Samples per second; that of the plant.
    plant : MatrixPlant
        Identified handle.
    options, prepared, latency
        As for `Compensation`, without the plant.

    Attributes
    ----------
    rejected : int
        Number of samples with a component that was not finite or not plausible. Nothing of such a
        sample is felt.
    untrusted : int
        Number of handle samples that were missing, or saturated in any component.

    Raises
    ------
    ParameterError
        The rate is not that of the plant or too low for the high-pass, or the latency is not
        allowed.
    """

    axes = ALL_AXES
    """Axes of the handle."""

    def __init__(
        self,
        parameters: CompensationParameters,
        rate: float,
        plant: MatrixPlant,
        options: Mapping[str, Checked] | None = None,
        prepared: Sequence[str] = (),
        *,
        latency: int = LATENCY,
    ) -> None:
        plant.check_rate(rate)
        self._options, self._latency = dict(options or {}), latency
        self._authority = Authority(rate, len(self.axes.names))
        self._axes = [
            Compensation(
                parameters,
                rate,
                {**(options or {}), PLANT: own},
                prepared,
                latency=latency,
                authority=self._authority,
            )
            for own in plant.axes
        ]
        self._guards = [axis.guard for axis in self._axes]
        self._supervisors = [axis.supervisor for axis in self._axes]
        self._alignment = Alignment(rate)
        sections = high_pass(parameters.high_pass_frequency, rate)
        self._high_pass = [SampleFilter(sections) for _ in self._axes]
        design = full_decoupling if parameters.decoupling == FULL else static_decoupling
        decoupling = design(plant, high_pass_frequency=parameters.high_pass_frequency)
        self._tool, self._seen = VectorConvolution(decoupling), VectorConvolution(decoupling)
        self._switch = ReductionSwitch(parameters.reduction, rate, self._tool.process)
        self._per_axis = parameters.saturation == PER_AXIS
        self._handle_range = AT_RANGE * parameters.handle_range
        self._handle = ZERO
        self.rejected = self.untrusted = 0
        self.reset()

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return self._axes[0].controller

    def select(self, name: str) -> None:
        """Change to another controller without a jump in force; see `Compensation.select`."""
        for axis in self._axes:
            axis.select(name)
        if name == self._judged:
            self._judge_anew()

    def select_reduction(self, name: str) -> None:
        """Change to another reduction, or to all axes, without a jump; see `ReductionSwitch`."""
        self._switch.select(name)
        if self._asleep:
            self._switch.settle()
            self._judge_anew()

    def set_gain(self, gain: float) -> None:
        """Change the factor of the desired acceleration; see `Compensation.set_gain`."""
        for axis in self._axes:
            axis.set_gain(gain)

    def process(self, tool: Vector, handle: Vector | None) -> tuple[Vector, Vector]:
        """Process one sample of tool and handle acceleration.

        Parameters
        ----------
        tool : tuple of float
            Measured tool acceleration, m/s^2. If any component is not finite or beyond
            `LARGEST_ACCELERATION`, all count as zero.
        handle : tuple of float or None
            Handle acceleration of the previous sample, m/s^2; None if it is missing.

        Returns
        -------
        desired_acceleration : tuple of float
            High-passed tool acceleration times the gain, m/s^2; in all axes also with a reduction.
        actuator_force : tuple of float
            Force of each coil within its limits, N; always finite.
        """
        tool = self._plausible(tool)
        if self._asleep and self._still(tool, handle):
            return ZERO, ZERO
        measured = self._measured(handle)
        (x, y, z), (rest_x, rest_y, rest_z) = tool, self._rest
        high_x, high_y, high_z = self._high_pass
        high = (
            high_x.process(x - rest_x),
            high_y.process(y - rest_y),
            high_z.process(z - rest_z),
        )
        axis_x, axis_y, axis_z = self._axes
        tool_x, tool_y, tool_z = self._switch.process(tool)
        m_x, m_y, m_z = measured
        d_x, f_x = axis_x.wanted(tool_x, m_x)
        d_y, f_y = axis_y.wanted(tool_y, m_y)
        d_z, f_z = axis_z.wanted(tool_z, m_z)
        if axis_x.asleep or axis_y.asleep or axis_z.asleep:  # a controller was unstable
            self.reset()
            return ZERO, ZERO
        gain = axis_x.gain  # the same for all axes
        desired = (gain * high[0], gain * high[1], gain * high[2])
        if alone := self._switch.alone:
            f_x, f_y = (1.0 - alone) * f_x, (1.0 - alone) * f_y
        force = self._limited((f_x, f_y, f_z))
        if self._reducible:
            self._due.append((0.0, 0.0, d_z) if self._judged_alone else desired)
            self._authority.observe_vector(self._due[0], self._judged_motion(m_x))
        self._alignment.observe([each.expected for each in self._supervisors], measured)
        axis_x.settle(d_x, m_x, force[0])
        axis_y.settle(d_y, m_y, force[1])
        axis_z.settle(d_z, m_z, force[2])
        return desired, force

    def adapt(self) -> None:
        """Execute a part of the slow computations; call it when no force is due."""
        if self._asleep:
            return
        for axis in self._axes:
            axis.adapt()
        self._alignment.update()
        if self._axes[0].active != self._judged or self._is_alone != self._judged_alone:
            self._judge_anew()
        elif self._reducible:
            self._authority.update(all([each.described for each in self._supervisors]))

    @property
    def _is_alone(self) -> bool:
        """True if the coil along z is driven alone."""
        return self._switch.active != NO_REDUCTION

    def _judged_motion(self, measured: float) -> Vector:
        """Return the part of the handle's motion that the driven coils shall cause, m/s^2."""
        if not math.isfinite(measured):
            return MISSING
        return (0.0, 0.0, self._handle[2]) if self._judged_alone else self._handle

    def _judge_anew(self) -> None:
        """Judge the active controller, with its full force at first."""
        self._judged_alone = self._is_alone
        self._judged = name = self._axes[0].active
        self._reducible = CONTROLLERS[name].reducible
        # The first one is due with the handle's sample of the previous tick.
        length = self._latency + granted_delay(name, self._options) + 2
        self._due = deque([ZERO] * length, maxlen=length)
        self._authority.reset()

    def mute(self, muted: bool) -> None:
        """Compute no force while the device applies none; see `Compensation.mute`."""
        for axis in self._axes:
            axis.mute(muted)

    def freeze(self, frozen: bool) -> None:
        """Stop or resume the adaptation of all controllers."""
        for axis in self._axes:
            axis.freeze(frozen)

    def reset(self) -> None:
        """Return to the initial state; the estimates of heat and travel remain."""
        for axis in self._axes:
            axis.reset()
        for each in self._high_pass:
            each.reset()
        self._alignment.reset()
        self._switch.settle()
        self._judge_anew()
        self._rest = ZERO
        self._seen_once = False
        self._asleep = True
        self._tool_at_rest: Vector | None = None
        self._handle_at_rest: Vector | None = None

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return a warning, or an empty string, and values with units for diagnostics."""
        warnings, values = [], {"controller": self.controller}
        for name, axis in zip(NAMES, self._axes, strict=True):
            warning, own = axis.diagnostics()
            warnings.append(f"{name}: {warning}" if warning else "")
            values |= {f"{name} {key}": own[key] for key in own if key not in _COMMON}
        reduced = ""
        if self._authority.reduced:
            reduced = f"{self._judged} is worse than no compensation: its force is reduced"
        counts = {
            "rejected": str(self.rejected),
            "handle not trusted": str(self.untrusted),
            "withheld": str(self._axes[0].withheld),
        }
        return ", ".join(
            filter(None, (self._alignment.warning, reduced, *warnings))
        ), values | counts

    def _still(self, tool: Vector, handle: Vector | None) -> bool:
        """Return whether all samples so far are equal; leave the idle state at a difference."""
        if self._tool_at_rest is None:
            self._tool_at_rest = tool
        if self._handle_at_rest is None:
            self._handle_at_rest = handle
        if tool == self._tool_at_rest and (handle is None or handle == self._handle_at_rest):
            return True
        self._asleep = False
        self._rest = self._tool_at_rest
        self._tool.fill(self._rest)
        for axis, rest in zip(self._axes, self._switch.process(self._rest), strict=True):
            axis.wake(rest)
        return False

    def _plausible(self, tool: Vector) -> Vector:
        x, y, z = tool
        most = LARGEST_ACCELERATION
        if abs(x) <= most and abs(y) <= most and abs(z) <= most:  # also false for NaN
            return tool
        self.rejected += 1
        return ZERO

    def _measured(self, handle: Vector | None) -> Vector:
        """Return the decoupled acceleration; see `MISSING` and `SATURATED`."""
        doubt = self._doubt(handle)
        if handle is not None and doubt is None:
            if not self._seen_once:
                # To a decoupling with zero past, gravity is a step.
                self._seen_once = True
                self._seen.fill(handle)
            self._handle = handle
        # If the handle's acceleration is unknown, it is assumed to be gravity.
        seen = self._seen.process(self._handle)
        return doubt or seen

    def _doubt(self, handle: Vector | None) -> Vector | None:
        """Return why a handle sample is not used; None for one that is."""
        if handle is None:
            self.untrusted += 1
            return MISSING
        x, y, z = handle
        most = self._handle_range
        if abs(x) < most and abs(y) < most and abs(z) < most:
            return None
        most = LARGEST_ACCELERATION
        if abs(x) <= most and abs(y) <= most and abs(z) <= most:
            self.untrusted += 1
            return SATURATED
        self.rejected += 1
        return MISSING

    def _limited(self, wanted: Vector) -> Vector:
        """Return the force within the limits of all coils, in the direction of the wanted one."""
        force = self._each_within(wanted)
        if force != wanted and not self._per_axis:
            # Again, for a coil that must be braked.
            x, y, z = scaled_within(wanted, force)
            force = self._each_within((x, y, z))
        for guard, each, felt in zip(self._guards, force, self._handle, strict=True):
            guard.advance(each, felt)
        return force

    def _each_within(self, force: Vector) -> Vector:
        """Return the force with each coil limited on its own."""
        guard_x, guard_y, guard_z = self._guards
        (x, y, z), (felt_x, felt_y, felt_z) = force, self._handle
        return guard_x.within(x, felt_x), guard_y.within(y, felt_y), guard_z.within(z, felt_z)


_COMMON = ("controller", "rejected", "handle not trusted", "withheld")
"""Diagnostics that are the same for all axes."""
