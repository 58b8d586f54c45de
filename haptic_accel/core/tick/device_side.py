# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""One device with its safety layer: samples, due forces, and the end of forces.

A force is due a whole number of samples after the sample that caused it. A controller can invert a
constant delay of a plant, but not a varying delay. The machine's monotonic clock decides whether a
force was in time. Pauses of the sending and of the applying process both count, as their effect on
a hand is the same.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from haptic_accel.core.actuator import MAX_AGE
from haptic_accel.core.model import LATER, ZERO
from haptic_accel.core.tick.kernels import INFINITE
from haptic_accel.core.tick.limits import ActuatorLimit, ArmLimit, SafetyLayer
from haptic_accel.core.tick.rigs import SimulatedArm
from haptic_accel.core.tick.samples import ArmSample, ArmWork, TimedForce
from haptic_accel.core.tick.watching import DurationHistogram

if TYPE_CHECKING:
    from collections.abc import Callable, Collection


ARM, ACTUATOR = "arm_force", "actuator_force"
"""Kinds of commands, named as in `Device.write`."""

NANOSECOND: float = 1e-9

OLDEST: float = MAX_AGE
"""Age of a sample above which its force is not sorted into the order of ticks, s."""

IN_TIME: float = 0.25
"""Maximum delay of a force beyond its due time that counts as in time, in periods.

During the delay the previous force acts. If every force were that late, the phase at a tenth of
the sampling rate would lag by 9 degrees, an error of 16 %. A smaller limit would count normal
waking, sampling and writing: 0.16 periods at 1 kHz (median, five processes on two shared cores).
"""

MISSED_SHARE: float = 0.001
"""Maximum fraction of missed deadlines for a rate that counts as sustained."""

STRAGGLING: int = 20
"""Maximum number of samples by which newer forces may overtake a force."""

PAST_TICK, LONGEST, LATE_TIME = "past their tick", "longest lateness (us)", "late (s)"
"""Suffixes of counts in diagnostics, after the kind of force."""

SAMPLE_TIMEOUT: float = 0.02
"""Time after which a missing sample counts as lost, s."""

FLOWING: int = 5
"""Number of ticks without a command after which none is expected."""

MEMORY: float = 0.3
"""Time after which the object of a sample is reused, s: longer than others wait for a sample, and
longer than a frame."""

NO_TICK: int = -(1 << 60)
"""Number that precedes those of all ticks."""


class DueForces:
    """Commands of one kind, from reception until they take effect.

    Ticks and samples are numbered by the points of the sampling grid.

    Parameters
    ----------
    latency : int
        Delay from sample to force, in samples; 0 for immediate application.
    period : float
        Period of the grid, s; point 0 is at 0 s of the monotonic clock.
    ahead : bool
        True if the device accepts forces before they are due.

    Attributes
    ----------
    due, missed, past_tick : int
        Numbers of forces: with a due time; that took effect later than `IN_TIME` allows; received
        after their tick.
    longest : float
        Maximum delay of a force beyond its due time, s.
    late_time : float
        Total time for which missed forces were due but not yet in effect, s.
    newest : int
        Number of the newest sample that caused a force; `NO_TICK` if none was received.
    stamp, x, y, z : int, float
        Stamp of the sample that caused the force taken last, ns, and the force, N.
    age : DurationHistogram
        Time from the sample that caused a force until its application.
    is_clocked : bool
        True if a clock of the device applies the forces that it accepts before they are due.
    late_before : int
        Number of forces that the device had already applied late when counting started.

    Examples
    --------
    >>> forces = DueForces(latency=1, period=1e-3)
    >>> forces.put(7, 7_000_000, 0.0, 0.0, 0.5)
    >>> forces.pop(7), forces.pop(8), forces.z
    (False, True, 0.5)
    >>> forces.took_effect(12e-3)
    >>> forces.missed, round(forces.longest, 6)
    (1, 0.004)
    """

    def __init__(self, latency: int, period: float, ahead: bool = False) -> None:
        self.ahead: bool = ahead and latency > 0
        self.latency: int = latency
        self.lag: int = 0 if self.ahead else latency
        self.period: float = period
        self.tolerance: float = IN_TIME * period if latency else INFINITE
        self.waiting: list[TimedForce] = []  # in the order of the ticks at which they are due
        self.spare: list[TimedForce] = []
        self.last: int = NO_TICK
        self.carried_out: int = NO_TICK
        self.newest: int = NO_TICK
        self.unrecorded: list[int] = []
        self.due = self.missed = self.past_tick = 0
        self.longest = self.late_time = self.late_until = 0.0
        self.is_outdated = self.is_clocked = False
        self.stamp = 0
        self.x = self.y = self.z = 0.0
        self.age: DurationHistogram = DurationHistogram()
        self.late_before = 0

    def put(self, sample: int, stamp: int, x: float, y: float, z: float) -> None:
        """Store a force until due; discard a force older than the last applied force."""
        due: int = sample + self.latency
        if self.latency:
            self.due += 1
            if due <= self.carried_out:
                self.past_tick += 1
        if sample > self.newest:
            self.newest = sample
        # A much older force was not overtaken: the safety layer rejects and reports it.
        if due <= self.last <= due + STRAGGLING:
            self.unrecorded.append(due)
            return
        spare, waiting = self.spare, self.waiting
        force: TimedForce = spare.pop() if spare else TimedForce()
        force.due, force.stamp, force.x, force.y, force.z = due, stamp, x, y, z
        at: int = len(waiting)
        while at > 0:
            before: TimedForce = waiting[at - 1]
            if before.due <= due:
                break
            at -= 1
        waiting.insert(at, force)

    def pass_on(self, stamp: int, x: float, y: float, z: float) -> None:
        """Pass an outdated force to the next `pop`, so that the safety layer rejects it.

        A stored force with a stamp in the future would be applied later as if it were in time.
        """
        self.is_outdated = True
        self.stamp, self.x, self.y, self.z = stamp, x, y, z

    def pop(self, tick: int, ahead: bool = False) -> bool:
        """Take the newest force that is due at a tick or earlier; return False if there is none.

        An outdated force is taken only if no other is due. `ahead` is true if the tick has not
        been executed yet.
        """
        if not ahead:
            self.carried_out = tick
        found: bool = self.is_outdated
        self.is_outdated = False
        waiting = self.waiting
        while waiting:
            force: TimedForce = waiting[0]
            due: int = force.due
            if due > tick:
                break
            self.spare.append(waiting.pop(0))
            # Of two forces for the same tick, the last one is taken.
            if due != self.last:
                self.last = due
                self.unrecorded.append(due)
            self.stamp, self.x, self.y, self.z = force.stamp, force.x, force.y, force.z
            found = True
        return found

    def took_effect(self, now: float, is_written: bool = False) -> None:
        """Record the monotonic time in s at which the last forces took effect or were skipped.

        If a force was written to the device, its age is counted. Forces taken ahead count as in
        time if the device's clock applies them.
        """
        if is_written:
            self.age.add(now - self.stamp * NANOSECOND)
        unrecorded = self.unrecorded
        if len(unrecorded) > 1:
            unrecorded.sort()
        while unrecorded:
            number: int = unrecorded.pop(0)
            time = number * self.period
            lateness = now - time
            if lateness > self.longest and self.latency:
                self.longest = lateness
            if lateness > self.tolerance:
                self.missed += 1
                # Time in which several forces were late counts once.
                since = time if time > self.late_until else self.late_until
                if now > since:
                    self.late_time += now - since
                self.late_until = now

    def is_missing(self, tick: int) -> bool:
        """Return True if commands arrive, but the command needed after a tick is missing."""
        needed = tick - self.lag
        return needed - FLOWING <= self.newest < needed

    def clear(self) -> None:
        """Discard the waiting forces."""
        self.waiting.clear()
        self.is_outdated = False

    def reset_counts(self, late: int = 0) -> None:
        """Reset the counts; the device has applied `late` forces late so far."""
        self.due = self.missed = self.past_tick = 0
        self.longest = self.late_time = 0.0
        self.age.reset()
        self.late_before = late

    def diagnostics(self) -> dict[str, str]:
        """Return all counts except `missed`, for diagnostics."""
        return {
            "due": str(self.due),
            PAST_TICK: str(self.past_tick),
            LONGEST: f"{self.longest * 1e6:.0f}",
            LATE_TIME: f"{self.late_time:.6f}",
        }


class DeviceSide:
    """One device behind its safety layer, processed tick by tick.

    Call `begin` at each tick. `read` takes the available samples, `apply` applies the forces that
    are due, and `watch` ends forces that have lasted too long. Forces may be passed to `command`
    at any time, but before `apply` if they are due at once.

    Parameters
    ----------
    device : haptic_accel.devices.Device
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
        True if the device accepts all forces before they are due. The device has no clock for a
        kind that is not in `ahead`: an overdue force takes effect when it is written.
    counted : collection of str, optional
        Kinds that the device applies, whose ages and deadlines are counted; default: all.
    servo : PositionServo, optional
        Position controller of the arm; replaces commands while it has a set-point.
    receive : callable
        Called before forces are applied, to pass received forces to `command`.

    Attributes
    ----------
    device : haptic_accel.devices.Device
    safety : SafetyLayer
    forces : dict of DueForces
        Commands by kind.
    counted : collection of str
    tick : int
        Newest tick.
    samples : list of ArmSample
        Samples of the last `read`, in order.
    newest : ArmSample or None
    unread : int
        Number of ticks without a sample.
    wants_contact : bool
        True if samples must include the force of the surface on the tool.
    sampling : bool
        True while the device is open; the caller sets it to false when closing the device.

    Raises
    ------
    DeviceError, OSError
        The device failed; raised by all methods that read or write it.
    """

    def __init__(
        self,
        device: Any,
        safety: SafetyLayer,
        rate: float,
        latency: int,
        clock: Callable[[], float] | None = None,
        *,
        kinds: Collection[str] = (ARM, ACTUATOR),
        ahead: Collection[str] = (),
        framed: bool = False,
        counted: Collection[str] | None = None,
        servo: Any = None,
        receive: Callable[[], None] | None = None,
    ) -> None:
        self.wants_contact = False
        self.safety: SafetyLayer = safety
        self.arm_limit: ArmLimit = safety.arm_limit
        self.actuator_limit: ActuatorLimit | None = safety.actuator_limit
        self.servo: Any = servo
        self.receive: Callable[[], None] | None = receive
        self.rate: float = rate
        self.latency: int = latency
        self.clock: Callable[[], float] | None = clock
        self.tick = self.unread = 0
        self.time = 0.0  # of the tick, s
        self.now: float = clock() if clock else 0.0
        self.forces: dict[str, DueForces] = {
            kind: DueForces(latency, 1 / rate, framed or kind in ahead) for kind in kinds
        }
        self.arm: DueForces | None = self.forces.get(ARM)
        self.actuator: DueForces | None = self.forces.get(ACTUATOR)
        self.is_arm_at_tick: bool = self.arm is not None and not self.arm.ahead
        self.is_coil_at_tick: bool = self.actuator is not None and not self.actuator.ahead
        for kind, each in self.forces.items():
            each.is_clocked = kind in ahead
        self.counted: Collection[str] = kinds if counted is None else counted
        self.timeout: int = max(1, round(SAMPLE_TIMEOUT * rate))
        self.waiting: list[int] = []
        self.work: ArmWork = ArmWork()
        self.last: int = round(MEMORY * rate) + 63
        self.index = 0
        self.start(device)
        self.samples: list[ArmSample] = []
        self.newest: ArmSample | None = None

    # Samples

    def start(self, device: Any) -> None:
        """Restart with a device that has just been opened."""
        self.device: Any = device
        self.sampling = True
        # A simulated device is called without tuples, and writes its readings to the samples.
        self.motion: SimulatedArm | None = getattr(device, "flat", None)
        self.ring: list[ArmSample] = []
        self.used = 0
        self.waiting.clear()
        before, self.work = self.work, ArmWork()
        self.work.unknown = before.unknown

    def begin(self, tick: int) -> None:
        """Begin a tick, at which a sample is due."""
        self.tick, self.time = tick, tick / self.rate
        self.waiting.append(tick)

    def read(self) -> None:
        """Take the available samples, in order; count the lost ones."""
        samples = self.samples
        samples.clear()
        waiting = self.waiting
        while waiting:
            tick: int = waiting[0]
            time = tick / self.rate
            used: int = self.used
            if used == len(self.ring):
                self.ring.append(ArmSample())
            sample: ArmSample = self.ring[used]
            motion = self.motion
            if motion is not None:
                motion.reading = sample
                motion.measure(time)
                del waiting[0]
            else:
                reading: Any = self.device.read(time)
                if reading is LATER and tick > self.tick - self.timeout:
                    return
                del waiting[0]
                if reading is LATER or reading is None:
                    self.unread += 1
                    continue
                sample.x, sample.y, sample.z = reading[0]
                sample.v_x, sample.v_y, sample.v_z = reading[1]
                sample.a_x, sample.a_y, sample.a_z = reading[2]
                sample.orientation = reading[3]
            self.used = used + 1 if used < self.last else 0
            sample.arm, sample.tick = self.index, tick
            sample.stamp = math.floor(tick * 1e9 / self.rate + 0.5)
            # Otherwise None, as the reused object may hold the force of an older sample.
            sample.contact = self.device.contact_force if self.wants_contact else None
            self.newest, self.is_measured = sample, True
            if self.servo is not None and self.servo.set_point:
                self.hold(tick, sample)
            self.work.until(time, sample)
            samples.append(sample)

    @property
    def unlocated(self) -> int:
        """Number of samples whose position is not finite; they cause no arm force."""
        return self.work.unknown

    @property
    def complete(self) -> bool:
        """True when all samples and commands of the newest tick have arrived."""
        tick = self.tick
        return not (
            self.waiting
            or (self.arm and self.arm.is_missing(tick))
            or (self.actuator and self.actuator.is_missing(tick))
        )

    # Forces

    def command(self, kind: str, moment: float, x: float, y: float, z: float) -> None:
        """Add a force, N, caused by the sample at a clock time, ns."""
        self.take(kind == ARM, math.floor(moment + 0.5), x, y, z)

    def take(self, is_arm: bool, stamp: int, x: float, y: float, z: float) -> None:
        """Add a force of the arm or the actuator, N, like `command`."""
        forces = self.arm if is_arm else self.actuator
        if forces is None:
            return
        if forces.newest == NO_TICK and is_arm:
            # The arms engage: late forces during start-up are not counted.
            for each in self.forces.values():
                each.reset_counts(self.device.late)
        sample: int = math.floor(stamp * self.rate * NANOSECOND + 0.5)
        now: float = self.time if self.clock is None else self.clock()
        if not -OLDEST <= now - stamp * NANOSECOND <= OLDEST:
            sample = self.tick - self.latency
            forces.pass_on(stamp, x, y, z)
        else:
            forces.put(sample, stamp, x, y, z)
            if is_arm and self.servo is not None:
                self.servo.set_point = None
        if forces.ahead:
            due: int = sample + self.latency
            # A force that is already late acts at once, and the device does not count it.
            forces.past_tick += due <= self.tick
            time = due / self.rate
            if not forces.is_clocked:
                now = self.clock() if self.clock else self.time
                time = time if time > now else now
            self.write_due(time, due, is_arm, not is_arm)

    def free(self) -> None:
        """Apply a zero force of the arm, as if computed from the last sample."""
        self.forces[ARM].put(self.tick, round(self.tick * 1e9 / self.rate), 0.0, 0.0, 0.0)

    def apply(self, is_late: bool = False) -> None:
        """Apply the forces that are due at the newest tick, or that arrived after their tick."""
        time = self.clock() if is_late and self.clock else self.time
        self.write_due(time, self.tick, self.is_arm_at_tick, self.is_coil_at_tick)

    def watch(self) -> None:
        """End forces whose commands have stopped; call once per tick after `apply`."""
        time = self.time
        started: float = time if self.clock is None else self.clock()
        # For the safety layer, whose time must never decrease.
        earlier, now = time if time < started else started, self.now
        if earlier > now:
            self.now = now = earlier
        if self.arm_limit.expires(now):
            self.write(time, started, True, False)
        coils, sample = self.actuator_limit, self.newest
        if coils is not None:
            if sample is None:
                changes = coils.tick(now, False, 0.0, 0.0, 0.0)
            else:
                changes = coils.tick(now, self.is_measured, sample.a_x, sample.a_y, sample.a_z)
            if changes:
                self.write(time, started, False, True)
        self.is_measured = False

    def take_off(self) -> None:
        """Set all forces to zero."""
        now = self.clock() if self.clock else self.time
        self.device.write(now, arm_force=ZERO, actuator_force=ZERO)
        self.work.apply(now, 0.0, 0.0, 0.0)

    def hold(self, tick: int, sample: ArmSample) -> None:
        """Command the position control's force for a sample while a position is commanded."""
        servo = self.servo
        if self.safety.refusal or self.safety.contested:
            servo.set_point = None
        elif force := servo.force(sample.position, sample.velocity):
            self.forces[ARM].put(tick, sample.stamp, *force)

    def write_due(self, time: float, tick: int, is_arm: bool, is_actuator: bool) -> None:
        """Write the newest forces due at a tick, limited by the safety layer."""
        started: float = self.time if self.clock is None else self.clock()
        # For the safety layer, whose time must never decrease.
        earlier, now = time if time < started else started, self.now
        if earlier > now:
            self.now = now = earlier
        arm = self.arm if is_arm else None
        actuator = self.actuator if is_actuator else None
        writes_arm = writes_actuator = False
        if arm is not None and arm.pop(tick, arm.ahead):
            age = started - arm.stamp * NANOSECOND
            writes_arm = self.arm_limit.command(now, age, arm.x, arm.y, arm.z)
        if actuator is not None and actuator.pop(tick, actuator.ahead):
            coils = self.actuator_limit
            if coils is not None:
                age = started - actuator.stamp * NANOSECOND
                writes_actuator = coils.command(now, age, actuator.x, actuator.y, actuator.z)
        if writes_arm or writes_actuator:
            self.write(time, started, writes_arm, writes_actuator)
        # Without a clock a force has no age.
        is_aged: bool = self.clock is not None
        done: float = started if self.clock is None else self.clock()
        if arm is not None:
            arm.took_effect(done, writes_arm and is_aged)
        if actuator is not None:
            actuator.took_effect(done, writes_actuator and is_aged)

    def write(self, time: float, judged: float, writes_arm: bool, writes_actuator: bool) -> None:
        """Write the forces that the safety layer allowed at a clock time, s.

        Write zero forces if the process was stopped since then (SIGSTOP) for longer than a sample
        is awaited.
        """
        coils, motion = self.actuator_limit, self.motion
        m_x = m_y = m_z = f_x = f_y = f_z = 0.0
        if self.clock is None or self.clock() - judged <= SAMPLE_TIMEOUT:
            arm = self.arm_limit
            m_x, m_y, m_z = arm.x, arm.y, arm.z
            if writes_actuator and coils is not None:
                f_x, f_y, f_z = coils.x, coils.y, coils.z
        if motion is not None:
            if writes_arm:
                motion.drive_at(time, True, m_x, m_y, m_z)
            if writes_actuator:
                motion.drive_at(time, False, f_x, f_y, f_z)
        elif not writes_arm:
            self.device.write(time, actuator_force=(f_x, f_y, f_z))
        elif not writes_actuator:
            self.device.write(time, arm_force=(m_x, m_y, m_z))
        else:
            force = (f_x, f_y, f_z)
            self.device.write(time, arm_force=(m_x, m_y, m_z), actuator_force=force)
        if writes_arm:
            self.work.apply(time, m_x, m_y, m_z)

    # Counts

    @property
    def deadlines(self) -> tuple[int, int]:
        """Numbers of forces with a due time, and of late forces."""
        return (
            sum(self.forces[kind].due for kind in self.counted),
            sum(map(self.missed, self.counted)),
        )

    @property
    def longest(self) -> float:
        """Maximum delay of a force beyond its due time, s."""
        return max((self.forces[kind].longest for kind in self.counted), default=0.0)

    def diagnostics(self) -> dict[str, str]:
        """Return counts and ages of the commands for diagnostics."""
        values = dict[str, str]()
        for kind in self.counted:
            each, name = self.forces[kind], kind.replace("_", " ")
            values |= {
                f"{name} count": str(each.age.count),
                **{f"{name} {key}": value for key, value in each.diagnostics().items()},
                f"{name} deadlines missed": str(self.missed(kind)),
                **each.age.diagnostics(f"{name} age"),
            }
        return values

    def missed(self, kind: str) -> int:
        """Return the number of forces that took effect late, here or in the device."""
        forces = self.forces[kind]
        there = self.device.late - forces.late_before if forces.ahead else 0
        return forces.missed + max(0, there)
