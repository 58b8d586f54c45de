"""What every command passes before a device gets it: one layer, for simulated devices too.

It only ever takes force away: what is applied lies between zero and what was asked for. It
trusts nobody: the compensator holds the actuator within limits as well, because a controller
must know what became of its force, but the device has to be safe whatever the compensator is,
and whether it is there. The layer's limits lie outside the compensator's (`HARD` and `COMFORT`
of `core.actuator`), so that with both in place only one of them acts.

It has no clock: times are the caller's, in s from any origin and never backwards.
"""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from typing import Any

from haptic_accel.core.actuator.guard import HARD, ActuatorGuard
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.actuator.travel import LARGEST_ACCELERATION
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, parameter

ACTUATOR_TIMEOUT = 5e-3
"""Silence after which the actuator is without force, s: five periods of the paper's loop."""

ARM_TIMEOUT = 20e-3
"""Silence after which an arm is without force, s: a hand moves millimetres meanwhile."""

LEAST_PERIODS = 2.5
"""Periods that a time-out lasts at least: one lost command is no silence."""

MAX_AGE = 0.1
"""Age of a sample from which on nothing is made of it, s; also how far clocks may differ."""

ARM_PEAK_FORCE = 3.3
"""Force of a Phantom Omni (data sheet), N."""

LASTING = 0.5
"""Time after which missing commands are worth a line of their own, s: shorter ones are counted."""

ROUNDING = 1e-9
"""Share by which the length of a force may exceed its limit and only be rounded."""

AUTOMATIC, MANUAL = "automatic", "manual"

GONE = "still missing"
"""What is said of commands that stopped coming longer ago than the last report."""

STOPPED = "emergency stop"
"""Why no force is allowed while it is not released."""

INACTIVE = "not active"
"""Why none is while the device is not to move."""


def _timeout(default: float) -> Any:
    return parameter(
        default,
        f"silence after which this force is zero; {LEAST_PERIODS:g} periods at least",
        unit="s",
        low=1e-3,
        high=10.0,
    )


def _max_age() -> Any:
    return parameter(
        MAX_AGE,
        "age of a command's sample, or its stamp's lead, from which on the force is zero",
        unit="s",
        low=1e-3,
        high=10.0,
    )


def _slew_rate() -> Any:
    return parameter(0.0, "how fast this force may grow; 0 for any", unit="N/s", low=0, high=1e6)


@dataclass(frozen=True)
class ArmLimits(Checked):
    """What an arm's motors may do."""

    command_timeout: float = _timeout(ARM_TIMEOUT)
    max_age: float = _max_age()
    peak_force: float = parameter(
        ARM_PEAK_FORCE,
        "limit of the arm's force (Phantom Omni: 3.3 N)",
        unit="N",
        low=0,
        high=100.0,
    )
    slew_rate: float = _slew_rate()


@dataclass(frozen=True)
class ActuatorCommandLimits(Checked):
    """Limits of the commands for the actuator, beside the actuator's own."""

    command_timeout: float = _timeout(ACTUATOR_TIMEOUT)
    max_age: float = _max_age()
    slew_rate: float = _slew_rate()


@dataclass(frozen=True)
class SafetyParameters(Checked):
    """Of a device with an arm."""

    recovery: str = parameter(
        AUTOMATIC,
        "what gives forces again after silence or an outdated command: the next good one, or"
        " only ~/arm",
        choices=(AUTOMATIC, MANUAL),
    )
    arm: ArmLimits = field(default_factory=ArmLimits)


@dataclass(frozen=True)
class MasterSafetyParameters(SafetyParameters):
    """Of a device with an arm and an actuator."""

    actuator: ActuatorCommandLimits = field(default_factory=ActuatorCommandLimits)
    hardware: ActuatorParameters = field(default_factory=ActuatorParameters)


class Watchdog:
    """Whether commands of one kind come, in time and in date.

    Silence after a command of zero is none: who stops that way has let go on purpose.

    Parameters
    ----------
    timeout, max_age : float
        s.
    manual : bool
        Whether only `arm` helps once it has tripped.

    Attributes
    ----------
    tripped : str
        Why no force is applied; empty if nothing is wrong.
    timeouts : int
        Times that commands stopped coming.
    outdated : int
        Commands whose sample was too old, or of a time to come.
    """

    def __init__(self, timeout: float, max_age: float, *, manual: bool) -> None:
        self._timeout = timeout
        self._max_age = max_age
        self._manual = manual
        self._heard: float | None = None
        self._tripped_at = 0.0
        self._told = False
        self.tripped = ""
        self.timeouts = self.outdated = 0

    @property
    def armed(self) -> bool:
        """Whether the next good command is applied."""
        return not (self._manual and self.tripped)

    def admits(self, now: float, age: float) -> bool:
        """Tell whether a command whose sample has an age in s may be applied now."""
        if not abs(age) <= self._max_age:  # true for NaN too
            self.outdated += 1
            # Of what came late before there was a force, nobody needs to recover.
            if self._heard is not None or not self._manual:
                self._trip(now, f"its sample is {age:.3g} s old")
            return False
        if self.tripped and self._manual:
            return False
        self.tripped = ""
        self._heard = now
        return True

    def went_silent(self, now: float) -> bool:
        """Tell, once, that commands have stopped coming."""
        if self._heard is None or now - self._heard < self._timeout:
            return False
        self.timeouts += 1
        self._trip(now, f"none for {self._timeout * 1e3:g} ms")
        return True

    def forget(self) -> None:
        """Expect no more commands until the next."""
        self._heard = None

    def rest(self) -> None:
        """Do not take it for a fault that no commands come; what waits for `arm` still does."""
        self.forget()
        if self.armed:
            self.tripped = ""

    def arm(self) -> None:
        """Let the next good command through."""
        self.tripped = ""
        self.forget()

    def news(self, now: float) -> str:
        """Return a line once for what lasts, and once when it is over; empty for nothing new."""
        if self.tripped and not self._told:
            if not self.armed:
                self._told = True
                return f"{self.tripped}; no force until armed again"
            if now - self._tripped_at > LASTING:
                self._told = True
                return f"{self.tripped}; no force until the next"
        elif self._told and not self.tripped:
            self._told = False
            return "allowed again"
        return ""

    def _trip(self, now: float, reason: str) -> None:
        if not self.tripped:
            self._tripped_at = now
            self.tripped = reason
        self.forget()


class _ArmChannel:
    """The commands for an arm."""

    name = "arm force"

    def __init__(self, limits: ArmLimits, rate: float, *, manual: bool) -> None:
        timeout = max(limits.command_timeout, LEAST_PERIODS / rate)
        self.watchdog = Watchdog(timeout, limits.max_age, manual=manual)
        self._peak = limits.peak_force
        self._slew = limits.slew_rate
        self._period = 1.0 / rate
        self._held = ZERO
        self._commanded = -math.inf
        self.rejected = self.limited = self.slewed = 0

    def command(self, now: float, age: float, force: Vector) -> Vector | None:
        x, y, z = force
        magnitude = math.sqrt(x * x + y * y + z * z)
        if not math.isfinite(magnitude):
            self.rejected += 1
            return None
        if not self.watchdog.admits(now, age):
            return self.let_go(now) if self._held != ZERO else None
        if magnitude > self._peak:
            if magnitude > self._peak * (1.0 + ROUNDING):
                self.limited += 1
            force = _scaled(force, self._peak / magnitude)
        if self._slew:
            force = self._slewed(now, force)
        if force == ZERO:
            self.watchdog.forget()
        self._held, self._commanded = force, now
        return force

    def tick(self, now: float) -> Vector | None:
        return self.let_go(now) if self.watchdog.went_silent(now) else None

    def let_go(self, now: float) -> Vector:
        """Hold no force from now on; return it."""
        self._held, self._commanded = ZERO, now
        return ZERO

    def _slewed(self, now: float, force: Vector) -> Vector:
        """Return what of a force is reached, from the part held that points its way."""
        most = self._slew * min(now - self._commanded, self._period)
        magnitude = math.hypot(*force)
        if magnitude <= most:
            return force
        before = max(0.0, _dot(self._held, force) / magnitude)
        if magnitude - before <= most:
            return force
        self.slewed += 1
        return _scaled(force, (before + most) / magnitude)

    def values(self) -> dict[str, str]:
        """Return counts for diagnostics."""
        return {
            "held (N)": f"{math.hypot(*self._held):.3f}",
            "rejected": str(self.rejected),
            "timeouts": str(self.watchdog.timeouts),
            "outdated": str(self.watchdog.outdated),
            "limited": str(self.limited),
            "slewed": str(self.slewed),
        }


class _ActuatorChannel:
    """The commands for the handle's actuator."""

    name = "actuator force"

    def __init__(
        self,
        limits: ActuatorCommandLimits,
        actuator: ActuatorParameters,
        rate: float,
        *,
        manual: bool,
    ) -> None:
        timeout = max(limits.command_timeout, LEAST_PERIODS / rate)
        self.watchdog = Watchdog(timeout, limits.max_age, manual=manual)
        self.guard = ActuatorGuard(actuator, rate, HARD)
        self._slew = limits.slew_rate
        self._rate = rate
        self._period = 1.0 / rate
        self._acceleration = 0.0
        self._ticked: float | None = None
        self._held = self._push = self._heat = 0.0
        self._since = self._commanded = -math.inf
        self.rejected = self.slewed = 0

    def command(self, now: float, age: float, force: float) -> float | None:
        if not math.isfinite(force):
            self.rejected += 1
            return None
        if not self.watchdog.admits(now, age):
            return self.let_go(now) if self._held else None
        if self._slew:
            force = self._slewed(now, force)
        if force:
            force = self._within(force)
        else:
            self.watchdog.forget()
        self._commanded = now
        return self._hold(now, force)

    def tick(self, now: float, handle_acceleration: float | None) -> float | None:
        """Note what the actuator did; return what it is to do instead, if it must not go on."""
        if handle_acceleration is not None and abs(handle_acceleration) <= LARGEST_ACCELERATION:
            self._acceleration = handle_acceleration
        held = self._held
        self._hold(now, held)
        self._advance(now)
        if self.watchdog.went_silent(now):
            return self.let_go(now)
        if not held:
            return None
        force = self._within(held)
        return None if force == held else self._hold(now, force)

    def let_go(self, now: float) -> float:
        """Hold no force from now on; return it."""
        self._commanded = now
        return self._hold(now, 0.0)

    def values(self) -> dict[str, str]:
        """Return counts, and what is left, for diagnostics."""
        guard = self.guard
        return {
            "held (N)": f"{self._held:.3f}",
            "rejected": str(self.rejected),
            "timeouts": str(self.watchdog.timeouts),
            "outdated": str(self.watchdog.outdated),
            "limited": str(guard.saturated),
            "limited by heat": str(guard.heated),
            "limited by travel": str(guard.cushioned),
            "slewed": str(self.slewed),
            "heat left (%)": f"{100.0 * max(0.0, 1.0 - guard.heat):.1f}",
            "travel (mm)": f"{1e3 * guard.travel:.2f}",
        }

    def _within(self, force: float) -> float:
        """Return what the guard leaves of a force; it may not brake with more, or backwards."""
        allowed = self.guard.within(force, self._acceleration)
        if allowed * force <= 0.0:
            return 0.0
        return allowed if abs(allowed) < abs(force) else force

    def _slewed(self, now: float, force: float) -> float:
        """Return what of a force is reached; through zero where its sign changes."""
        most = self._slew * min(now - self._commanded, self._period)
        before = abs(self._held) if self._held * force > 0.0 else 0.0
        if abs(force) - before <= most:
            return force
        self.slewed += 1
        return math.copysign(before + most, force)

    def _hold(self, now: float, force: float) -> float:
        """Note that a force acts from now on, and for how long the one before did."""
        if self._ticked is not None:
            time = now - self._since
            self._push += self._held * time
            self._heat += self._held * self._held * time
        self._held, self._since = force, now
        return force

    def _advance(self, now: float) -> None:
        """Tell the guard what acted since the last tick, also if that is long ago."""
        if self._ticked is None:
            self._ticked = now
            return
        elapsed = now - self._ticked
        samples = round(elapsed * self._rate)
        if samples < 1:  # two ticks for one grid point: what acted is counted with the next
            return
        mean, square = self._push / elapsed, self._heat / elapsed
        self.guard.advance(mean, self._acceleration, square=square, samples=samples)
        self._ticked, self._push, self._heat = now, 0.0, 0.0


class SafetyLayer:
    """Gives a device what is left of each command, and zero where one is missing.

    Forces are allowed once it is `enable`d, and not while it is stopped. Methods that take a
    command return what to write, or None where the device is to go on as it is.

    Parameters
    ----------
    parameters : SafetyParameters
        `MasterSafetyParameters` for a device with an actuator.
    rate : float
        Ticks per second, Hz.

    Attributes
    ----------
    stopped : bool
        Whether the emergency stop forbids every force.
    active : bool
        Whether the device is to move at all.
    """

    def __init__(self, parameters: SafetyParameters, rate: float) -> None:
        manual = parameters.recovery == MANUAL
        self._arm = _ArmChannel(parameters.arm, rate, manual=manual)
        self._actuator: _ActuatorChannel | None = None
        self._channels: list[_ArmChannel | _ActuatorChannel] = [self._arm]
        if isinstance(parameters, MasterSafetyParameters):
            self._actuator = _ActuatorChannel(
                parameters.actuator, parameters.hardware, rate, manual=manual
            )
            self._channels.append(self._actuator)
        self._warned: defaultdict[str, int] = defaultdict(int)
        self.stopped = self.active = False

    @property
    def refusal(self) -> str:
        """Why no force is allowed, whatever is commanded; empty if one is."""
        if self.stopped:
            return STOPPED
        return "" if self.active else INACTIVE

    @property
    def disarmed(self) -> str:
        """Which forces wait for `arm`, and why; empty for none."""
        waiting = [c for c in self._channels if not c.watchdog.armed]
        return ", ".join(f"{c.name}: {c.watchdog.tripped}" for c in waiting)

    def arm_force(self, now: float, age: float, force: Vector) -> Vector | None:
        """Take a command for the arm, N, made of a sample of an age in s."""
        if self.stopped or not self.active:
            return None
        return self._arm.command(now, age, force)

    def actuator_force(self, now: float, age: float, force: float) -> float | None:
        """Take a command for the actuator, N, made of a sample of an age in s."""
        if self.stopped or not self.active or self._actuator is None:
            return None
        return self._actuator.command(now, age, force)

    def tick(
        self, now: float, handle_acceleration: float | None = None
    ) -> tuple[Vector | None, float | None]:
        """Return what arm and actuator are to do instead of what they do; once a period.

        Parameters
        ----------
        now : float
            s.
        handle_acceleration : float, optional
            As just measured, m/s^2; None where it is not known.
        """
        arm = self._arm.tick(now)
        if self._actuator is None:
            return arm, None
        return arm, self._actuator.tick(now, handle_acceleration)

    def stop(self, now: float, stopped: bool) -> None:
        """Allow no force, or release; the caller takes those off that there are."""
        self.stopped = stopped
        self._let_go(now)

    def enable(self, now: float, active: bool) -> None:
        """Allow forces, or none; the caller takes those off that there are."""
        self.active = active
        self._let_go(now)
        if active:
            self.arm()

    def arm(self) -> str:
        """Allow forces after silence or an outdated command; return why not, if not."""
        if self.refusal:
            return self.refusal
        for channel in self._channels:
            channel.watchdog.arm()
        return ""

    def news(self, now: float) -> list[str]:
        """Return lines worth telling at once, each once."""
        told = ((c.name, c.watchdog.news(now)) for c in self._channels)
        return [f"{name}: {line}" for name, line in told if line]

    def warnings(self) -> list[str]:
        """Return what is wrong now, and what went wrong since this was last asked."""
        found = [self.refusal] if self.refusal else []
        if self.disarmed:
            found.append(f"not armed: {self.disarmed}")
        for channel in self._channels:
            watchdog = channel.watchdog
            counts = {
                f"{channel.name} went silent": watchdog.timeouts,
                f"{channel.name} out of date": watchdog.outdated,
                f"{channel.name} not finite": channel.rejected,
            }
            new = [said for said, count in counts.items() if count > self._warned[said]]
            self._warned.update(counts)
            if not new and watchdog.tripped and watchdog.armed:
                new = [f"{channel.name} {GONE}"]
            found += new
        return found

    def status(self) -> dict[str, str]:
        """Return counts, and what is left of the actuator's limits, for diagnostics."""
        values = {"forces allowed": str(not (self.refusal or self.disarmed)).lower()}
        for channel in self._channels:
            for name, value in channel.values().items():
                values[f"{channel.name} {name}"] = value
        return values

    def _let_go(self, now: float) -> None:
        for channel in self._channels:
            channel.let_go(now)
            channel.watchdog.rest()


def _dot(one: Vector, other: Vector) -> float:
    return sum(a * b for a, b in zip(one, other, strict=True))


def _scaled(force: Vector, share: float) -> Vector:
    x, y, z = force
    return x * share, y * share, z * share
