# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compensation: the force of each coil for a sample of tool and handle, within all limits."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from haptic_accel.core.actuator import ActuatorParameters
from haptic_accel.core.axes import ACTUATOR_AXES, ALL_AXES, LIVE_REDUCTIONS, NO_REDUCTION, Axes
from haptic_accel.core.control.authority import Authority
from haptic_accel.core.control.channel import LARGEST_GAIN, Channel
from haptic_accel.core.control.controllers import CONTROLLERS, CONTROLLERS_GROUP, Loop
from haptic_accel.core.control.controllers import PLANT as PLANT
from haptic_accel.core.control.fallback import NO_CONTROLLER, TURNS
from haptic_accel.core.control.filters import HIGH_PASS_FREQUENCY, check_corner, high_pass
from haptic_accel.core.control.sensor_faults import HEARS, HowlingDetector, SensorWatch
from haptic_accel.core.control.three_coils import Alignment, ReductionSwitch, full_decoupling
from haptic_accel.core.handle.plant import MatrixPlant, Plant, read_matrix_plant
from haptic_accel.core.model import ACTUATOR, GRAVITY, ZERO, Vector
from haptic_accel.core.parameters import Checked, ParameterError, parameter
from haptic_accel.core.sampling import LATENCY
from haptic_accel.core.tick import LARGEST_ACCELERATION as LARGEST_ACCELERATION
from haptic_accel.core.tick import HandleCompensation, Trace, VectorConvolution
from haptic_accel.core.tick.watching import DurationHistogram

AT_RANGE = 0.999
"""Fraction of full scale above which a handle sample counts as saturated, as converters differ."""

STUCK = 0.03
"""Duration of equal samples, while a force acts, after which the handle's accelerometer counts as
stuck, s. Slow forces that cause 0.1 m/s^2 do not change the reading of a noise-free 12-bit
converter with a range of 10 g for half this time."""

LOUD = 0.2
"""Noise of an axis of the handle's accelerometer above which diagnostics warn, m/s^2 RMS: three
times that of the paper's sensor, or a tenth of a strong texture."""


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
        HIGH_PASS_FREQUENCY, "corner of the Butterworth high-pass, order 4 (paper)", "Hz", 0.1, 1e3
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
        1.0, "factor of the desired acceleration; a change takes 50 ms", "", 0, LARGEST_GAIN
    )
    axes: str = parameter("z", "axes of the handle's coils: z, or x, y, z")
    reduction: str = parameter(
        NO_REDUCTION,
        "reduction of the tool's three axes to one, which moves the coil along z alone: none (all"
        " axes that the handle has), the component along z, the sum, or the component along the"
        " strongest vibration",
        choices=(NO_REDUCTION, *LIVE_REDUCTIONS),
    )


def check_axes(
    parameters: CompensationParameters, options: Mapping[str, Checked], rate: float
) -> Axes:
    """Return the axes of the parameters after a check of their plant and rate.

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
    """Return the three-axis plant that the parameters specify."""
    plant = options.get(PLANT, Plant())
    assert isinstance(plant, Plant)
    if not plant.model:
        return MatrixPlant.uncoupled(plant, rate)
    found = read_matrix_plant(Path(plant.model))
    x, y, z = (replace(each, coupling=plant.coupling) for each in found.axes)
    return replace(found, axes=(x, y, z))


class Compensation(HandleCompensation):
    """High-pass, controllers and actuator limits of a handle with n coils, one sample at a time.

    Each coil has its own channel: a controller with supervision and learning that models only the
    coil's own plant. With several coils, tool and handle acceleration are decoupled first, see
    `core.control.three_coils`. The limits are common: if a coil reaches its peak force, its heat
    limit or its travel limit, the whole force is scaled and keeps its direction. The direction
    changes only if a coil must be braked before its stop.

    With a reduction, the channel along z receives the reduced tool acceleration, and the other
    coils have zero force. Their decoupled axes then do not move, and the axis along z moves as
    with a single coil, so supervision and learning continue.

    Stays idle until a sample differs from the first one since the start or a reset. In the idle
    state there is no force, no counting and no adaptation, so an instance that was idle gives
    exactly the results of a new instance. The noise of a real accelerometer ends the idle state at
    once. The first sample is the tool's acceleration at rest, mostly gravity, so that the filters
    see no step.

    Parameters
    ----------
    parameters : CompensationParameters
        Controller, high-pass corner, sensor range and axes.
    rate : float
        Samples per second; above twice the high-pass corner, and that of a three-axis plant.
        Samples per second; above twice the high-pass corner, and that of a plant of three axes.
    options : mapping, optional
        Parameters of controllers (by name), of the actuator (`ACTUATOR`) and of the identified
        handle (`PLANT`) that differ from the defaults; see `matrix_plant` for three axes.
    prepared : sequence of str
        Controllers to build in advance, so that `select` takes no time.
    latency : int
        Delay from sample to force, in samples.
    plant : MatrixPlant, optional
        Identified handle with three axes, instead of the one that the parameters specify.
    clock : callable, optional
        Steady time of slow computations, s, to detect a slow controller of another package. The
        default is constant, as in lockstep.

    Attributes
    ----------
    axes : Axes
        Axes of the handle.
    channels : list of Channel
        Controllers of the coils, one for each axis.
    due : int
        Count of samples, see `Trace`, at which `adapt` next has something to do.
    slow_work : DurationHistogram
        Durations of the parts of the slow computations, measured with `clock`.
    failure : str
        Reason why `none` replaced the last selected controller; empty if it did not.

    Raises
    ------
    ParameterError
        The rate is too low for the high-pass, or differs from the plant's; the latency is not
        allowed; there are two axes; or the model has another number of axes.
    """

    authority: Authority
    switch: ReductionSwitch
    _work_due: int

    def __init__(
        self,
        parameters: CompensationParameters,
        rate: float,
        options: Mapping[str, Checked] | None = None,
        prepared: Sequence[str] = (),
        *,
        latency: int = LATENCY,
        plant: MatrixPlant | None = None,
        clock: Callable[[], float] = float,
    ) -> None:
        known = dict(options or {})
        corner = parameters.high_pass_frequency
        check_corner(rate, corner)
        self.axes = ALL_AXES if plant else check_axes(parameters, known, rate)
        single = self.axes == ACTUATOR_AXES
        plants: Sequence[Plant]
        if single:
            own = known.get(PLANT, Plant())
            assert isinstance(own, Plant)
            plants = [own]
        else:
            coupled = plant or matrix_plant(known, rate)
            coupled.check_rate(rate)
            plants = coupled.axes
            taps = full_decoupling(coupled, high_pass_frequency=corner)
            self.tool_decoupling = VectorConvolution(taps)
            self.handle_decoupling = VectorConvolution(taps)
        actuator = known.get(ACTUATOR, ActuatorParameters())
        assert isinstance(actuator, ActuatorParameters)
        traces = [Trace() for _ in plants]
        self.authority = Authority(rate, traces if single else [Trace() for _ in plants])
        self.channels = [
            Channel(
                parameters.controller,
                Loop(rate, corner, each.coupled().delayed(latency), actuator.travel, clock),
                known,
                prepared,
                parameters.gain,
                self.authority,
                trace,
            )
            for each, trace in zip(plants, traces, strict=True)
        ]
        coils = [channel.supervisor for channel in self.channels]
        self.failure = ""
        self.slow_work, self._clock = DurationHistogram(), clock
        sections = high_pass(corner, rate)
        self.howling = [
            HowlingDetector(rate, channel.supervisor, sections, each.handle.m_h)
            for channel, each in zip(self.channels, plants, strict=True)
        ]
        self.sensors = SensorWatch(rate, traces)
        self.alignment = None if single else Alignment(rate, coils)
        self.switch = ReductionSwitch(parameters.reduction, rate, self._unreduced)
        # A value at the limit counts as saturated.
        handle_range = math.nextafter(AT_RANGE * parameters.handle_range, 0.0)
        super().__init__([*self.channels], sections, handle_range, round(STUCK * rate))
        self._begin_again()

    @property
    def controller(self) -> str:
        """Name of the active controller, or of the last selected one."""
        return self.channels[0].controller

    def select(self, name: str) -> None:
        """Change to another controller without a jump in force; see `Channel.select`.

        Raises
        ------
        ParameterError
            The controller does not exist, or its parameters are invalid.
        """
        for channel in self.channels:
            channel.select(name)
        if name != NO_CONTROLLER:
            self.failure = ""
            for each in self.howling:
                each.reset()

    def select_reduction(self, name: str) -> None:
        """Change to another reduction, or to all axes, without a jump; see `ReductionSwitch`."""
        self.switch.select(name)
        if self.first.asleep:
            self.switch.settle()
            self._restart_evaluation()

    def set_gain(self, gain: float) -> None:
        """Change the factor of the desired acceleration; immediately in the idle state."""
        for channel in self.channels:
            channel.set_gain(gain)

    def process(self, tool: Vector, handle: Vector | None) -> tuple[Vector, Vector]:
        """Process one sample of tool and handle acceleration.

        Parameters
        ----------
        tool : tuple of float
            Measured tool acceleration, m/s^2. If a component in use is not finite or exceeds
            `LARGEST_ACCELERATION`, all components count as zero. Otherwise one bad sample could
            corrupt the filters or keep the actuator at its limit for seconds.
        handle : tuple of float or None
            Handle acceleration at the previous sample, m/s^2, as the present sample may not have
            arrived. None if it is missing.

        Returns
        -------
        desired_acceleration : tuple of float
            High-passed tool acceleration times the gain, m/s^2; also with a reduction, in all axes
            of the handle.
        actuator_force : tuple of float
            Force of each coil within its limits, N; always finite.
        """
        self.compute(*tool, handle is not None, *(handle or ZERO))
        desired = self.desired_x, self.desired_y, self.desired_z
        return desired, (self.force_x, self.force_y, self.force_z)

    def adapt(self) -> None:
        """Execute a part of the slow computations if one is due; call it while no force is due."""
        count = self.first.trace.count
        if count < self.due or self.first.asleep:
            return
        started = self._clock()
        self._listen()
        if count >= self._work_due:
            self._work_due = count + self._work()
        self.due = min(self._work_due, count + max(1, self.howling[0].left))
        self.slow_work.add(self._clock() - started)

    def _listen(self) -> None:
        """Interrupt the force if the tool may pick it up; end it if the tool does."""
        for howling in self.howling:
            howling.update()
        is_proved = any(each.proved for each in self.howling)
        if is_proved and self.controller != NO_CONTROLLER:
            self.select(NO_CONTROLLER)
            self.failure = HEARS
        for channel in self.channels:
            channel.fallback.hushed = is_proved or any(each.suspects for each in self.howling)

    def _work(self) -> int:
        """Execute a part of the deferrable work; return the samples left to the next part."""
        left = [channel.adapt() for channel in self.channels]  # all in the same sample
        left.append(self.sensors.update(self.rejected, self.untrusted))
        self._replace_failed()
        if self.alignment:
            left.append(self.alignment.update())
        if self._is_alone != self.judged_alone:
            self._restart_evaluation()
        elif self.first.substitution.reducible:
            # Not in the samples in which the channels' supervision is computed.
            if self.authority.left <= 0 and self.first.trace.count % TURNS:
                self.authority.update(all(each.supervisor.described for each in self.channels))
            left.append(max(1, self.authority.left))
        if self.switch.name != self.switch.active or 0.0 < self.switch.alone < 1.0:
            left.append(1)  # the coil along z may soon be driven alone, or no longer alone
        return min(left)

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
        for each in self.high_passes:
            each.reset()
        if self.alignment:
            self.alignment.reset()
        self._begin_again()
        self._replace_failed()

    def _replace_failed(self) -> None:
        """Select `none` if the controller has failed in any channel."""
        failures = [channel.failure for channel in self.channels if channel.failure]
        if failures and self.controller != NO_CONTROLLER:
            self.select(NO_CONTROLLER)
            self.failure = failures[0]

    def diagnostics(self) -> tuple[str, dict[str, str]]:
        """Return a warning, or an empty string, and values with units for diagnostics.

        With several axes, the keys of a channel start with the name of its axis.
        """
        values = {"controller": self.controller}
        for name, channel in zip(self.axes.names, self.channels, strict=True):
            own = channel.diagnostics()
            before = "" if self.single else f"{name} "
            values |= {f"{before}{key}": value for key, value in own.items()}
        counts = {
            "rejected": str(self.rejected),
            "handle not trusted": str(self.untrusted),
            "withheld": str(self.first.withheld),
        }
        return self.warning, values | counts

    @property
    def warning(self) -> str:
        """Warnings of axes and channels, and about sensor noise and a reduced force."""
        found = [self.alignment.warning] if self.alignment else []
        for name, channel in zip(self.axes.names, self.channels, strict=True):
            warning = channel.warning
            found.append(warning if self.single or not warning else f"{name}: {warning}")
        authority = self.authority
        found += self.failure, self.sensors.warning
        noise = authority.noise / math.sqrt(len(self.channels))
        if LOUD <= noise < math.inf:
            found.append(f"the handle's accelerometer has {noise:.2f} m/s^2 RMS of noise")
        if authority.reduced:
            name = self.first.active.name
            found.append(f"{name} is worse than no compensation: its force is reduced")
        return ", ".join(filter(None, found))

    def _begin_again(self) -> None:
        """Enter the idle state, until two samples differ."""
        self.due = self._work_due = 0
        self.sensors.reset()
        for each in self.howling:
            each.reset()
        self.switch.settle()
        self._restart_evaluation()
        self.tool_x = self.tool_y = self.tool_z = 0.0
        self.has_tool = self.has_handle = self.has_seen = False

    def _restart_evaluation(self) -> None:
        """Restart the evaluation of the active controller, with its full force at first."""
        self.judged_alone = self._is_alone
        self.authority.reset()

    @property
    def _is_alone(self) -> bool:
        """True if, of several coils, only the one along z is driven."""
        return not self.single and self.switch.active != NO_REDUCTION

    def wake(self) -> None:
        """End the idle state of the channels, for a tool at rest."""
        rest = self.tool_x, self.tool_y, self.tool_z
        if not self.single:
            self.tool_decoupling.fill(*rest)
        shaped = self.switch.process(rest)
        for channel, index in zip(self.channels, self.axes.indices, strict=True):
            channel.wake(shaped[index])

    def _unreduced(self, tool: Vector) -> Vector:
        """Return the input of the channels without a reduction."""
        if self.single:
            return tool
        decoupled = self.tool_decoupling
        decoupled.process(*tool)
        return decoupled.x, decoupled.y, decoupled.z
