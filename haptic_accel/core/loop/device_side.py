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

"""Device part of the loop: samples, and forces that take effect at their due time if safe."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection, Iterator
from typing import Any, NamedTuple, Protocol

from haptic_accel.core.actuator.safety import MAX_AGE, SafetyParameters
from haptic_accel.core.axes import ACTUATOR_AXES, Axes
from haptic_accel.core.coupling.position_servo import PositionServo
from haptic_accel.core.due_forces import DueForces
from haptic_accel.core.evaluation.histogram import DurationHistogram
from haptic_accel.core.model import LATER, ZERO, Reading, Sample, Vector
from haptic_accel.core.sampling import NANOSECONDS
from haptic_accel.core.tick import SafetyLayer

ARM, ACTUATOR = "arm_force", "actuator_force"
"""Kinds of commands, named as in `DrivenDevice.write`."""

SAMPLE_TIMEOUT = 0.02
"""Time after which a missing sample counts as lost, s."""

FLOWING = 5
"""Number of ticks without a command after which no command is expected."""


class DrivenDevice(Protocol):
    """Interface of a device for the loop; see `haptic_accel.devices.Device`."""

    @property
    def late(self) -> int:
        """Number of forces received in advance but applied by the device after their due time."""

    @property
    def contact_force(self) -> Vector | None:
        """Force of the surface on the tool at the last sample, N; None if unknown."""

    def read(self, time: float) -> Reading:
        """Return the sample at a time, s."""

    def write(
        self, time: float, *, arm_force: Vector | None = None, actuator_force: Vector | None = None
    ) -> None:
        """Apply the forces, N, that are due at a time, s."""


class TickSample(NamedTuple):
    """Sample of a tick, the arm motors' work until then, J, per axis, and the surface's force, N.

    The force is None if it is unknown.
    """

    tick: int
    sample: Sample
    work: Vector
    contact: Vector | None


class Commands:
    """Commands of one kind, from reception until they take effect.

    Parameters
    ----------
    latency : int
    period : float
        As for `DueForces`.
    ahead : bool
        The device accepts forces before they are due.

    Attributes
    ----------
    forces : DueForces
    age : DurationHistogram
        Time from the sample that caused a force until its application.
    ahead : bool
    late_before : int
        Number of forces that the device had applied late before counting began.
    """

    def __init__(self, latency: int, period: float, *, ahead: bool) -> None:
        self.ahead = ahead and latency > 0
        self.forces = DueForces(latency, period)
        self.age = DurationHistogram()
        self.late_before = 0
        self._lag = 0 if self.ahead else latency

    def is_missing(self, tick: int) -> bool:
        """Return whether commands arrive, but the command needed after a tick is missing."""
        newest, needed = self.forces.newest, tick - self._lag
        return newest is not None and needed - FLOWING <= newest < needed


class DeviceSide:
    """One device behind its safety layer, processed tick by tick.

    Call `begin` at each tick. `read` yields the available samples, `apply` applies the forces that
    are due, and `watch` ends forces that have lasted too long. Forces may be passed to `command`
    at any time, but before `apply` if they are due at once.

    Parameters
    ----------
    device : DrivenDevice
    safety : SafetyLayer
    rate : float
        Ticks per second.
    latency : int
        Delay from sample to force, in ticks.
    clock : callable, optional
        Monotonic time, s, with tick 0 at 0; default: the time of the tick, as in lockstep.
    kinds : collection of str
        Kinds of commands: `ARM`, `ACTUATOR`.
    ahead : collection of str
        Kinds that the device accepts before they are due.
    framed : bool
        The device accepts all forces before they are due. A kind that is not in `ahead` has no
        clock of the device: a force that is overdue takes effect when it is given.
    counted : collection of str, optional
        Kinds that the device applies, whose ages and deadlines count; default: all.
    servo : PositionServo, optional
        Position control of the arm; replaces commands while it has a set-point.
    receive : callable
        Called before forces are applied, to pass received forces to `command`.

    Attributes
    ----------
    device : DrivenDevice
    safety : SafetyLayer
    commands : dict of Commands
        Commands by kind.
    counted : collection of str
    tick : int
        Newest tick.
    newest : Sample or None
    unread : int
        Number of ticks without a sample.
    sampling : bool
        True while the device is open; the caller sets it to false when closing the device.

    Raises
    ------
    DeviceError, OSError
        The device failed; raised by all methods that read or write it.
    """

    def __init__(
        self,
        device: DrivenDevice,
        safety: SafetyLayer,
        rate: float,
        latency: int,
        clock: Callable[[], float] | None = None,
        *,
        kinds: Collection[str] = (ARM, ACTUATOR),
        ahead: Collection[str] = (),
        framed: bool = False,
        counted: Collection[str] | None = None,
        servo: PositionServo | None = None,
        receive: Callable[[], None] = lambda: None,
    ) -> None:
        self.device = device
        self.safety, self._servo, self.receive = safety, servo, receive
        self._arm, self._actuator = safety.arm_limit, safety.actuator_limit
        self.rate, self.latency, self.sampling = rate, latency, True
        self.clock = clock or self._time_of_tick
        self.tick = self.unread = 0
        self._watched = -1
        self._now = self.clock()
        self._clocked = ahead
        self.commands = {
            kind: Commands(latency, 1 / rate, ahead=framed or kind in ahead) for kind in kinds
        }
        self.counted = kinds if counted is None else counted
        self._at_tick = [kind for kind, each in self.commands.items() if not each.ahead]
        self._timeout = max(1, round(SAMPLE_TIMEOUT * rate))
        self._waiting: deque[int] = deque()
        self._work = ArmWork()
        self._acceleration: Vector | None = None
        self.newest: Sample | None = None

    # Samples

    def start(self, device: DrivenDevice) -> None:
        """Restart with a device that has just been opened."""
        self.device, self.sampling = device, True
        self._waiting.clear()
        before, self._work = self._work, ArmWork()
        self._work.unknown = before.unknown

    def begin(self, tick: int) -> None:
        """Begin a tick, whose sample is due."""
        self.tick = tick
        self._waiting.append(tick)

    def read(self) -> Iterator[TickSample]:
        """Yield the available samples, in order; count the lost ones."""
        while self._waiting:
            tick = self._waiting[0]
            time = tick / self.rate
            sample = self.device.read(time)
            if sample is LATER:
                if tick > self.tick - self._timeout:
                    return
                sample = None
            self._waiting.popleft()
            if sample is None:
                self.unread += 1
                continue
            self.newest = sample
            self._acceleration = sample.acceleration
            if self._servo and self._servo.set_point:
                self._hold(tick, sample)
            work = self._work.until(time, sample.position)
            yield TickSample(tick, sample, work, self.device.contact_force)

    @property
    def unlocated(self) -> int:
        """Number of samples whose position is not finite: they cause no force of the arm."""
        return self._work.unknown

    @property
    def complete(self) -> bool:
        """True when all samples and commands of the newest tick have arrived."""
        # Lists, as generators would dominate the time of a tick.
        return not self._waiting and not any(
            [each.is_missing(self.tick) for each in self.commands.values()]
        )

    # Forces

    def command(self, kind: str, moment: float, force: Vector) -> None:
        """Add a force, N, caused by the sample at a clock time, ns."""
        commands = self.commands[kind]
        if kind == ARM and commands.forces.newest is None:
            # The arms engage: late forces during start-up are not counted.
            self._count_anew()
        sample = round(moment * self.rate / NANOSECONDS)
        if abs(self.clock() - moment / NANOSECONDS) > MAX_AGE:
            sample = self.tick - self.latency
            commands.forces.pass_on(round(moment), force)
        else:
            commands.forces.put(sample, round(moment), force)
            if kind == ARM and self._servo:
                self._servo.set_point = None
        if commands.ahead:
            due = sample + self.latency
            # A force that is already late acts at once, and the device does not count it.
            commands.forces.past_tick += due <= self.tick
            time = due / self.rate
            given = time if kind in self._clocked else max(time, self.clock())
            self._write_due(given, due, [kind])

    def free(self) -> None:
        """Apply a zero force of the arm, as if computed from the last sample."""
        self.commands[ARM].forces.put(self.tick, self._moment(self.tick), ZERO)

    def refuse(self, kind: str) -> None:
        """Discard the waiting commands of a kind."""
        self.commands[kind].forces.clear()

    def apply(self) -> None:
        """Apply the forces that are due at the newest tick."""
        self._write_due(self.tick / self.rate, self.tick, self._at_tick)

    def watch(self) -> None:
        """End forces without a new command for too long; call once per tick after `apply`."""
        if self._watched == self.tick:
            return
        self._watched = self.tick
        time = self.tick / self.rate
        acceleration, self._acceleration = self._acceleration, None
        begun = self.clock()
        x, y, z = acceleration or ZERO
        now, arm, actuator = self._advanced(time, begun), self._arm, self._actuator
        if arm.expires(now):
            self._write(time, {ARM: (arm.x, arm.y, arm.z)}, begun)
        if actuator and actuator.tick(now, acceleration is not None, x, y, z):
            self._write(time, {ACTUATOR: (actuator.x, actuator.y, actuator.z)}, begun)

    def apply_late(self) -> None:
        """Apply the forces that arrived after their due tick."""
        self._write_due(self.clock(), self.tick, self._at_tick)

    def take_off(self) -> None:
        """Set all forces to zero."""
        now = self.clock()
        self._write(now, {ARM: ZERO, ACTUATOR: ZERO}, now)

    # Counts

    @property
    def deadlines(self) -> tuple[int, int]:
        """Numbers of forces with a due time, and of late forces."""
        return (
            sum(self.commands[kind].forces.due for kind in self.counted),
            sum(map(self._missed, self.counted)),
        )

    @property
    def longest(self) -> float:
        """Maximum delay of a force beyond its due time, s."""
        return max((self.commands[kind].forces.longest for kind in self.counted), default=0.0)

    def diagnostics(self) -> dict[str, str]:
        """Return counts and ages of the commands for diagnostics."""
        values = dict[str, str]()
        for kind in self.counted:
            each, name = self.commands[kind], kind.replace("_", " ")
            values |= {
                f"{name} count": str(each.age.count),
                **{f"{name} {key}": value for key, value in each.forces.diagnostics().items()},
                f"{name} deadlines missed": str(self._missed(kind)),
                **each.age.diagnostics(f"{name} age"),
            }
        return values

    def _count_anew(self) -> None:
        for each in self.commands.values():
            each.age.reset()
            each.forces.count_anew()
            each.late_before = self.device.late

    def _missed(self, kind: str) -> int:
        """Return the number of forces that took effect late, here or at the device."""
        commands = self.commands[kind]
        there = self.device.late - commands.late_before if commands.ahead else 0
        return commands.forces.missed + max(0, there)

    def _hold(self, tick: int, sample: Sample) -> None:
        """Command the position control's force for a sample while a position is commanded."""
        assert self._servo
        if self.safety.refusal or self.safety.contested:
            self._servo.set_point = None
        elif force := self._servo.force(sample.position, sample.velocity):
            self.commands[ARM].forces.put(tick, self._moment(tick), force)

    def _write_due(self, time: float, tick: int, kinds: Collection[str]) -> None:
        """Write the newest forces due at a tick, limited by the safety layer."""
        begun = self.clock()
        now = self._advanced(time, begun)
        given: dict[str, Any] = {}
        moments: dict[str, int] = {}
        for kind in kinds:
            commands = self.commands[kind]
            if caused := commands.forces.pop(tick, ahead=commands.ahead):
                moment, force = caused
                limit = self._arm if kind == ARM else self._actuator
                if limit and limit.command(now, begun - moment / NANOSECONDS, *force):
                    given[kind], moments[kind] = (limit.x, limit.y, limit.z), moment
        try:
            if given:
                self._write(time, given, begun)
        finally:
            done = self.clock()
            for kind in kinds:
                self.commands[kind].forces.took_effect(done)
        for kind, moment in moments.items():
            self.commands[kind].age.add(done - moment / NANOSECONDS)

    def _write(self, time: float, forces: dict[str, Any], judged: float) -> None:
        """Write forces that the safety layer allowed at a clock time, s.

        No force if the process was stopped since (SIGSTOP) for longer than samples are waited for.
        """
        if self.clock() - judged > SAMPLE_TIMEOUT:
            forces = dict.fromkeys(forces, ZERO)
        self.device.write(time, **forces)
        if (arm := forces.get(ARM)) is not None:
            self._work.apply(time, arm)

    def _advanced(self, time: float, now: float) -> float:
        """Return a time for the safety layer, s, which never decreases."""
        self._now = max(self._now, min(time, now))
        return self._now

    def _time_of_tick(self) -> float:
        return self.tick / self.rate

    def _moment(self, tick: int) -> int:
        return round(tick * NANOSECONDS / self.rate)


def rig_side(
    device: DrivenDevice,
    limits: SafetyParameters,
    rate: float,
    latency: int,
    kinds: Collection[str] = (ARM, ACTUATOR),
    axes: Axes = ACTUATOR_AXES,
) -> DeviceSide:
    """Return one side of a virtual rig for lockstep, with a safety layer that allows forces."""
    safety = SafetyLayer(limits, rate, axes)
    safety.enable(0.0, True)
    return DeviceSide(device, safety, rate, latency, kinds=kinds)


KEPT = 1000
"""Maximum number of force changes that wait for the next sample; beyond, the oldest are merged."""


class ArmWork:
    """Cumulative sum of applied force times displacement, per axis.

    The work between two samples is the held force times the change of position. This is exact for
    a force that changes at samples only. For other changes (late, or set to zero by a watchdog)
    the displacement is divided assuming constant velocity. With an acceleration a and a period T
    the error is at most a T^2 / 8 times the change of force: 1 uJ for 1 N, 8 m/s^2 and 1 ms. A
    lost sample makes the period longer.

    The forces are the commands to the device, at the times of the calls. Delays and suppressed
    forces inside the device are unknown here.

    Examples
    --------
    >>> work = ArmWork()
    >>> work.until(0.0, (0.0, 0.0, 0.0))
    (0.0, 0.0, 0.0)
    >>> work.apply(0.0, (2.0, 0.0, -1.0))
    >>> work.until(0.001, (0.5, 7.0, 0.25))
    (1.0, 0.0, -0.25)
    """

    def __init__(self) -> None:
        self.unknown = 0  # samples without a position
        self._sum = ZERO
        self._time = -math.inf
        self._position: Vector | None = None
        self._force = ZERO
        self._changes: deque[tuple[float, Vector]] = deque(maxlen=KEPT)

    def apply(self, time: float, force: Vector) -> None:
        """Record that a force, N, is held from a time on, s; times must increase."""
        self._changes.append((time, force))

    def until(self, time: float, position: Vector) -> Vector:
        """Return the work up to a sample, J, per axis.

        Parameters
        ----------
        time : float
            Time of the sample, s; it may precede the last forces.
        position : tuple of float
            Position at the sample, m; counts as lost if not finite.
        """
        # One line per axis here and below, as a loop over them takes four times longer.
        x, y, z = position
        if not math.isfinite(x + y + z):
            self.unknown += 1
            return self._sum
        before, since = self._position, self._time
        f_x, f_y, f_z = self._mean_force(since, time)
        self._position, self._time = position, time
        if before is not None:
            (w_x, w_y, w_z), (b_x, b_y, b_z) = self._sum, before
            self._sum = w_x + f_x * (x - b_x), w_y + f_y * (y - b_y), w_z + f_z * (z - b_z)
        return self._sum

    def _mean_force(self, since: float, time: float) -> Vector:
        """Return the mean force between two times, and discard the forces before the second."""
        held, changes = self._force, self._changes
        x, y, z = held
        while changes and changes[0][0] <= time:
            moment, force = changes.popleft()
            left = (time - max(moment, since)) / (time - since) if time > since else 0.0
            if left:
                x += (force[0] - held[0]) * left
                y += (force[1] - held[1]) * left
                z += (force[2] - held[2]) * left
            held = force
        self._force = held
        return x, y, z
