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

"""Compensation: the force of each coil for a sample of tool and handle, within all limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ACTUATOR_AXIS, ALL_AXES, Axes
from haptic_accel.core.control.alignment import Alignment
from haptic_accel.core.control.authority import Authority
from haptic_accel.core.control.channel import Channel
from haptic_accel.core.control.controllers import CONTROLLERS, CONTROLLERS_GROUP, Loop
from haptic_accel.core.control.controllers import PLANT as PLANT
from haptic_accel.core.control.decoupling import (
    VectorConvolution,
    full_decoupling,
    static_decoupling,
)
from haptic_accel.core.control.filters import (
    HIGH_PASS_FREQUENCY,
    SampleFilter,
    check_corner,
    high_pass,
)
from haptic_accel.core.control.gain import LARGEST_GAIN
from haptic_accel.core.control.reduction_switch import ReductionSwitch, Shaping
from haptic_accel.core.handle.matrix_plant import MatrixPlant, read_matrix_plant
from haptic_accel.core.handle.plant import Plant
from haptic_accel.core.model import ACTUATOR, GRAVITY, ZERO, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.reduction import LIVE_REDUCTIONS, NO_REDUCTION
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.tick import LARGEST_ACCELERATION as LARGEST_ACCELERATION
from haptic_accel.core.tick import Trace, scale_within

AT_RANGE = 0.999
"""Fraction of full scale above which a handle sample counts as saturated, as converters differ."""

FULL, STATIC = "full", "static"
"""Decoupling of three coils: with the dynamics of their coupling, or without."""

DIRECTION, PER_AXIS = "direction", "per_axis"
"""Limits of three coils: with the direction of the force kept, or each coil on its own."""

LOUD = 0.2
"""Noise of an axis of the handle's accelerometer that is reported, m/s^2 RMS: three times that of
the paper's sensor, or a tenth of a strong texture."""


@dataclass(frozen=True)
class CompensationParameters(Checked):
    """Controller, high-pass corner, and range of the handle's accelerometer."""

    controller: str = parameter(
        "dynamic",
        "controller of the actuator's force",
        choices=tuple(CONTROLLERS),
        group=CONTROLLERS_GROUP,
    )
    high_pass_frequency: float = parameter(
        HIGH_PASS_FREQUENCY,
        "corner of the 4th-order Butterworth high-pass (paper)",
        "Hz",
        0.1,
        1000.0,
    )
    handle_range: float = parameter(
        5 * GRAVITY,
        "range of the handle's accelerometer; samples at its limits are not used (paper: 5 g)",
        "m/s^2",
        0,
        LARGEST_ACCELERATION,
        above=True,
    )
    gain: float = parameter(
        1.0,
        "factor of the desired acceleration; a change takes 50 ms",
        "",
        0,
        LARGEST_GAIN,
    )
    axes: str = parameter("z", "axes of the handle's coils: z, or x, y, z")
    reduction: str = parameter(
        NO_REDUCTION,
        "reduction of the tool's three axes to one, which moves the coil along z alone: none (all"
        " axes that the handle has), the component along z, the sum, or the component along the"
        " strongest vibration",
        choices=(NO_REDUCTION, *LIVE_REDUCTIONS),
    )
    decoupling: str = parameter(
        FULL,
        "decoupling of three coils by the inverse of their coupling: with its dynamics, or its"
        " mean over frequency alone",
        choices=(FULL, STATIC),
    )
    saturation: str = parameter(
        DIRECTION,
        "limits of three coils: keep the direction of the force, or limit each coil on its own",
        choices=(DIRECTION, PER_AXIS),
    )


def check_axes(
    parameters: CompensationParameters, options: Mapping[str, Checked], rate: float
) -> Axes:
    """Return the axes of the parameters after a check that all goes with them.

    Raises
    ------
    ParameterError
        There are two axes, or the plant's model has another number of axes or another rate.
    """
    axes = Axes.parsed(parameters.axes)
    if axes not in (ACTUATOR_AXES, ALL_AXES):
        raise ParameterError(f"axes = {parameters.axes}: must be z, or x, y, z")
    if axes == ALL_AXES:
        matrix_plant(options, rate).check_rate(rate)
    return axes


def matrix_plant(options: Mapping[str, Checked], rate: float) -> MatrixPlant:
    """Return the plant with three axes that the parameters name."""
    plant = options.get(PLANT, Plant())
    assert isinstance(plant, Plant)
    if not plant.model:
        return MatrixPlant.uncoupled(plant, rate)
    found = read_matrix_plant(Path(plant.model))
    x, y, z = (replace(each, coupling=plant.coupling) for each in found.axes)
    return replace(found, axes=(x, y, z))


class Compensation:
    """High-pass, controllers and actuator limits of a handle with n coils, one sample at a time.

    Each coil has a channel of its own: a controller with supervision and learning, which sees the
    coil's plant alone. With several coils, tool and handle acceleration are decoupled before, see
    `core.control.decoupling`. The limits are common: where a coil reaches its peak force, its heat
    or its travel, the whole force is scaled and keeps its direction. Only a coil that must be
    braked before its stop leaves it.

    With a reduction, the channel along z receives the reduced tool acceleration, and other coils
    have no force. Without their force, a decoupled axis moves by none, and the one of z as with a
    single coil: supervision and learning go on.

    Stays idle until a sample differs from the first one since the start or a reset. While idle
    there is no force, no count and no adaptation. An instance that was idle thus gives exactly the
    results of a new instance. The noise of a real accelerometer ends the idle state at once. The
    first sample is the tool's acceleration at rest, mostly gravity, so that the filters see no
    step.

    Parameters
    ----------
    parameters : CompensationParameters
        Controller, high-pass corner, sensor range and axes.
    rate : float
        Samples per second; above twice the high-pass corner, and that of a plant of three axes.
    options : mapping, optional
        Parameters that differ from the defaults: of controllers by name, of the actuator
        (`ACTUATOR`) and of the identified handle (`PLANT`); see `matrix_plant` for three axes.
    prepared : sequence of str
        Controllers to build in advance, so that `select` takes no time.
    latency : int
        Delay from sample to force, in samples.
    plant : MatrixPlant, optional
        Identified handle with three axes, in place of the one that the parameters name.

    Attributes
    ----------
    axes : Axes
        Axes of the handle.
    channels : list of Channel
        Controllers of the coils, one for each axis.
    rejected : int
        Number of samples with a component in use that was not finite or not plausible. Tool
        samples become zero, handle samples count as missing.
    untrusted : int
        Number of handle samples that were missing, or saturated in any component.
    due : int
        Count of samples, see `Trace`, from which `adapt` has something to do.
    count_force : tuple of float
        Part of the arm's force on the handle that its encoders' rounding causes, N; due with the
        coils' forces of the next sample.

    Raises
    ------
    ParameterError
        The rate is too low for the high-pass, or not the plant's; the latency is not allowed; or
        there are two axes, or the model has another number of axes.
    """

    def __init__(
        self,
        parameters: CompensationParameters,
        rate: float,
        options: Mapping[str, Checked] | None = None,
        prepared: Sequence[str] = (),
        *,
        latency: int = LATENCY,
        plant: MatrixPlant | None = None,
    ) -> None:
        known = dict(options or {})
        corner = parameters.high_pass_frequency
        check_corner(rate, corner)
        self.axes = ALL_AXES if plant else check_axes(parameters, known, rate)
        self._indices = self.axes.indices
        self._single = self.axes == ACTUATOR_AXES
        self._vector = _along if self._single else _all
        plants: Sequence[Plant]
        self._seen: VectorConvolution | None = None
        self._high_pass: list[SampleFilter] = []
        shaping: Shaping = _unchanged
        if self._single:
            own = known.get(PLANT, Plant())
            assert isinstance(own, Plant)
            plants = [own]
        else:
            coupled = plant or matrix_plant(known, rate)
            coupled.check_rate(rate)
            plants = coupled.axes
            design = full_decoupling if parameters.decoupling == FULL else static_decoupling
            decoupling = design(coupled, high_pass_frequency=corner)
            self._tool, self._seen = VectorConvolution(decoupling), VectorConvolution(decoupling)
            shaping = self._tool.process
            sections = high_pass(corner, rate)
            self._high_pass = [SampleFilter(sections) for _ in plants]
        actuator = known.get(ACTUATOR, ActuatorParameters())
        assert isinstance(actuator, ActuatorParameters)
        traces = [Trace() for _ in plants]
        moved = traces if self._single else [Trace() for _ in plants]
        self._authority = Authority(rate, moved)
        self.channels = [
            Channel(
                parameters.controller,
                Loop(rate, corner, each.coupled().delayed(latency), actuator.travel),
                known,
                prepared,
                parameters.gain,
                self._authority,
                trace,
            )
            for each, trace in zip(plants, traces, strict=True)
        ]
        self._first = self.channels[0]
        # Tuples, as a loop over them takes half the time of one that pairs lists.
        self._coils = tuple(zip(range(len(plants)), self._indices, self.channels, strict=True))
        self._guards = tuple((coil, index, each.guard) for coil, index, each in self._coils)
        coils = [channel.supervisor for channel in self.channels]
        self._alignment = None if self._single else Alignment(rate, coils)
        self._switch = ReductionSwitch(parameters.reduction, rate, shaping)
        self._per_axis = parameters.saturation == PER_AXIS
        self._handle_range = AT_RANGE * parameters.handle_range
        self._handle = self.count_force = ZERO
        self.due = self.rejected = self.untrusted = 0
        self._begin_again()

    @property
    def asleep(self) -> bool:
        """True in the idle state."""
        return self._first.asleep

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return self._first.controller

    def select(self, name: str) -> None:
        """Change to another controller without a jump in force; see `Channel.select`.

        Raises
        ------
        ParameterError
            The controller does not exist, or its parameters are invalid.
        """
        for channel in self.channels:
            channel.select(name)

    def select_reduction(self, name: str) -> None:
        """Change to another reduction, or to all axes, without a jump; see `ReductionSwitch`."""
        self._switch.select(name)
        if self.asleep:
            self._switch.settle()
            self._judge_anew()

    @property
    def gain(self) -> float:
        """Factor of the desired acceleration of the last sample."""
        return self._first.gain

    def set_gain(self, gain: float) -> None:
        """Change the factor of the desired acceleration; in the idle state at once."""
        for channel in self.channels:
            channel.set_gain(gain)

    def process(self, tool: Vector, handle: Vector | None) -> tuple[Vector, Vector]:
        """Process one sample of tool and handle acceleration.

        Parameters
        ----------
        tool : tuple of float
            Measured tool acceleration, m/s^2. If a component in use is not finite or beyond
            `LARGEST_ACCELERATION`, all count as zero. Otherwise one bad sample could corrupt the
            filters or keep the actuator at its limit for seconds.
        handle : tuple of float or None
            Handle acceleration of the previous sample, m/s^2, as the present sample may not have
            arrived. None if it is missing.

        Returns
        -------
        desired_acceleration : tuple of float
            High-passed tool acceleration times the gain, m/s^2; in all axes also with a reduction,
            if the handle has them.
        actuator_force : tuple of float
            Force of each coil within its limits, N; always finite.
        """
        if not self._is_plausible(tool):
            self.rejected += 1
            tool = ZERO
        if self.asleep and self._still(tool, handle):
            return ZERO, ZERO
        measured = self._measured(handle)
        shaped = self._switch.process(tool)
        own, forces = [], []  # desired acceleration and force of each coil
        for coil, index, channel in self._coils:
            acceleration, force = channel.requested(
                shaped[index], measured[coil], self.count_force[index]
            )
            if channel.asleep:  # its controller was unstable
                self.reset()
                return ZERO, ZERO
            own.append(acceleration)
            forces.append(force)
        desired = own
        if self._seen:
            desired, forces = self._desired(tool), self._driven(forces)
        forces = self._limited(forces)
        if self._first.is_reducible and not self._single:
            self._observe(own, desired, measured)
        for coil, _, channel in self._coils:
            channel.settle(own[coil], measured[coil], forces[coil])
        return self._vector(desired), self._vector(forces)

    def adapt(self) -> None:
        """Execute a part of the slow computations, if any is due; call it when no force is."""
        if self._first.trace.count < self.due or self.asleep:
            return
        left = [channel.adapt() for channel in self.channels]  # all at the same time
        if self._alignment:
            left.append(self._alignment.update())
        if self._is_alone != self._judged_alone:
            self._judge_anew()
        elif self._first.is_reducible:
            if not self._first.is_supervising:
                self._authority.update(all(each.supervisor.described for each in self.channels))
            left.append(self._authority.left)
        if self._switch.name != self._switch.active or 0.0 < self._switch.alone < 1.0:
            left.append(1)  # the coil along z may soon be alone, or no longer
        self.due = self._first.trace.count + min(left)

    def mute(self, muted: bool) -> None:
        """Compute no force while the device applies none; see `Channel.mute`."""
        for channel in self.channels:
            channel.mute(muted)

    def freeze(self, frozen: bool) -> None:
        """Stop or resume the adaptation of all controllers."""
        for channel in self.channels:
            channel.freeze(frozen)

    def reset(self) -> None:
        """Return to the initial state; the estimates of the coils' heat and travel remain."""
        for channel in self.channels:
            channel.reset()
        for each in self._high_pass:
            each.reset()
        if self._alignment:
            self._alignment.reset()
        self._begin_again()

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return a warning, or an empty string, and values with units for diagnostics.

        With several axes, those of a channel begin with the name of its axis.
        """
        warnings, values = [], {"controller": self.controller}
        for name, channel in zip(self.axes.names, self.channels, strict=True):
            warning, own = channel.diagnostics()
            if self._single:
                warnings.append(warning)
                values |= own
            else:
                warnings.append(f"{name}: {warning}" if warning else "")
                values |= {f"{name} {key}": value for key, value in own.items()}
        counts = {
            "rejected": str(self.rejected),
            "handle not trusted": str(self.untrusted),
            "withheld": str(self._first.withheld),
        }
        alignment = self._alignment.warning if self._alignment else ""
        texts = alignment, *warnings, *self._common_warnings()
        return ", ".join(filter(None, texts)), values | counts

    def _common_warnings(self) -> list[str]:
        """Return warnings for all axes: noise of the accelerometer, and a reduced force."""
        authority, found = self._authority, []
        noise = authority.noise / math.sqrt(len(self.channels))
        if LOUD <= noise < math.inf:
            found.append(f"the handle's accelerometer has {noise:.2f} m/s^2 RMS of noise")
        if authority.reduced:
            name = self._first.active
            found.append(f"{name} is worse than no compensation: its force is reduced")
        return found

    def _begin_again(self) -> None:
        """Enter the idle state, until two samples differ."""
        self.due = 0
        self._switch.settle()
        self._judge_anew()
        self._rest = ZERO
        self._seen_once = False
        self._tool_at_rest: Vector | None = None
        self._handle_at_rest: Vector | None = None

    def _judge_anew(self) -> None:
        """Judge the active controller, with its full force at first."""
        self._judged_alone = self._is_alone
        self._authority.reset()

    @property
    def _is_alone(self) -> bool:
        """True if the coil along z is driven alone, among others."""
        return not self._single and self._switch.active != NO_REDUCTION

    def _is_plausible(self, tool: Vector) -> bool:
        x, y, z = tool
        most = LARGEST_ACCELERATION
        if not abs(z) <= most:  # also false for NaN
            return False
        # A tool that has its one axis may send anything along others.
        return (abs(x) <= most and abs(y) <= most) or (self._single and not self._switch.reduces)

    def _still(self, tool: Vector, handle: Vector | None) -> bool:
        """Return whether all samples so far are equal; end the idle state if two differ."""
        if self._tool_at_rest is None:
            self._tool_at_rest = tool
        if self._handle_at_rest is None:
            self._handle_at_rest = handle
        used = ALL_AXES.indices if self._switch.reduces else self._indices
        if _equal(tool, self._tool_at_rest, used) and (
            handle is None or _equal(handle, self._handle_at_rest, self._indices)
        ):
            return True
        self._wake(self._tool_at_rest)
        return False

    def _wake(self, rest: Vector) -> None:
        """End the idle state; `rest` is the acceleration of the tool at rest, m/s^2."""
        self._rest = rest
        if self._seen:
            self._tool.fill(rest)
        shaped = self._switch.process(rest)
        for channel, index in zip(self.channels, self._indices, strict=True):
            channel.wake(shaped[index])

    def _measured(self, handle: Vector | None) -> Sequence[float]:
        """Return the decoupled acceleration; NaN if missing, infinite if saturated."""
        doubt = self._doubt(handle)
        if handle is not None and not doubt:
            if self._seen and not self._seen_once:
                # To a decoupling with zero past, gravity is a step.
                self._seen_once = True
                self._seen.fill(handle)
            self._handle = handle
        # If the handle's acceleration is unknown, it is assumed to be gravity.
        seen = self._seen.process(self._handle) if self._seen else self._handle
        if doubt:
            return [doubt] * len(self._indices)
        return seen if self._seen else (seen[ACTUATOR_AXIS],)

    def _doubt(self, handle: Vector | None) -> float:
        """Return NaN for a missing handle sample, infinity for a saturated one; otherwise 0."""
        if handle is None:
            self.untrusted += 1
            return math.nan
        for index in self._indices:
            if not abs(handle[index]) < self._handle_range:
                break
        else:
            return 0.0
        if all([abs(handle[index]) <= LARGEST_ACCELERATION for index in self._indices]):
            self.untrusted += 1
            return math.inf
        self.rejected += 1
        return math.nan

    def _desired(self, tool: Vector) -> list[float]:
        """Return the desired acceleration of the handle, without the decoupling of the coils."""
        gain = self.gain  # the same for all axes
        rest = self._rest
        return [
            gain * each.process(tool[coil] - rest[coil])
            for coil, each in enumerate(self._high_pass)
        ]

    def _driven(self, forces: list[float]) -> list[float]:
        """Return the forces of the coils in use."""
        if not (alone := self._switch.alone):
            return forces
        shares = [1.0 if index == ACTUATOR_AXIS else 1.0 - alone for index in self._indices]
        return [share * force for share, force in zip(shares, forces, strict=True)]

    def _observe(
        self, own: Sequence[float], desired: Sequence[float], measured: Sequence[float]
    ) -> None:
        """Pass the desired motion of the driven coils, and the measured one, to the authority."""
        is_known = math.isfinite(measured[0])
        for coil, index, _ in self._coils:
            wanted = desired[coil]
            moved = self._handle[index] if is_known else math.nan
            if self._judged_alone:
                # What the coil along z shall cause is its own channel's.
                is_driven = index == ACTUATOR_AXIS
                wanted, moved = (own[coil], moved) if is_driven else (0.0, 0.0)
            self._authority.traces[coil].push(wanted, moved, 0.0, 0.0)

    def _limited(self, asked: list[float]) -> list[float]:
        """Return the forces within the limits of all coils, in the direction of those asked."""
        handle = self._handle
        force = self._each_within(asked)
        if force != asked:
            self._hold()
            if any(asked):  # or a moving coil is braked
                self._authority.limit(max(map(abs, force)) / max(map(abs, asked)))
            if self._seen and not self._per_axis:
                # Again, for a coil that must be braked.
                for coil, _, guard in self._guards:
                    guard.asked, guard.allowed = asked[coil], force[coil]
                scale_within([guard for _, _, guard in self._guards])
                force = self._each_within([guard.allowed for _, _, guard in self._guards])
        for coil, index, guard in self._guards:
            guard.advance(force[coil], handle[index])
        return force

    def _hold(self) -> None:
        """Name no difference of the handle while a limit acts."""
        for channel in self.channels:
            channel.supervisor.hold()
        if self._alignment:
            self._alignment.hold()

    def _each_within(self, force: Sequence[float]) -> list[float]:
        """Return the forces with each coil limited on its own."""
        handle, allowed = self._handle, []
        for coil, index, guard in self._guards:
            allowed.append(guard.within(force[coil], handle[index]))
        return allowed


def _equal(one: Vector, other: Vector | None, indices: Sequence[int]) -> bool:
    """Return whether two vectors have the same components, or are one object (also with NaN)."""
    return other is not None and [one[i] for i in indices] == [other[i] for i in indices]


def _unchanged(tool: Vector) -> Vector:
    """Return the tool's acceleration, for a coil along one axis."""
    return tool


def _along(components: Sequence[float]) -> Vector:
    """Return the vector with the only component along the actuator."""
    return 0.0, 0.0, components[0]


def _all(components: Sequence[float]) -> Vector:
    """Return the vector with all components."""
    x, y, z = components
    return x, y, z
