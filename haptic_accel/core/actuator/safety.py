"""Safety layer between commands and devices, simulated devices included.

It only reduces forces: the applied force lies between zero and the commanded one. It does not
rely on the compensator. That limits the actuator as well, because a controller must know the
force that was applied, but the device has to be safe with any compensator and without one. The
layer's limits lie outside the compensator's (`HARD` and `COMFORT` of `core.actuator.guard`), so
that with both in place only one of them acts.

It has no clock: times are given by the caller, in s from any origin and never backwards.
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
"""Default time-out of the actuator's commands, s: five periods of the paper's loop."""

ARM_TIMEOUT = 20e-3
"""Default time-out of an arm's commands, s: a hand moves millimetres in that time."""

LEAST_PERIODS = 2.5
"""Minimum time-out in periods, so that one lost command does not trip the watchdog."""

MAX_AGE = 0.1
"""Default maximum age of a command's sample, s; also the maximum difference of clocks."""

ARM_PEAK_FORCE = 3.3
"""Maximum force of a Phantom Omni (data sheet), N."""

LASTING = 0.5
"""Duration above which missing commands are logged, s: shorter interruptions are only counted."""

ROUNDING = 1e-9
"""Relative excess of a force over its limit that counts as a rounding error."""

AUTOMATIC, MANUAL = "automatic", "manual"

GONE = "still missing"
"""Warning for commands that stopped before the last report and have not come back."""

STOPPED = "emergency stop"
"""Reason for zero force while the emergency stop is not released."""

INACTIVE = "not active"
"""Reason for zero force while the device's node is not active."""


def _timeout(default: float) -> Any:
    return parameter(
        default,
        f"time without a command after which this force is zero; {LEAST_PERIODS:g} periods at"
        " least",
        unit="s",
        low=1e-3,
        high=10.0,
    )


def _max_age() -> Any:
    return parameter(
        MAX_AGE,
        "maximum age of a command's sample, or lead of its stamp; the force is zero beyond",
        unit="s",
        low=1e-3,
        high=10.0,
    )


def _slew_rate() -> Any:
    return parameter(
        0.0, "maximum rate of growth of this force; 0 for no limit", unit="N/s", low=0, high=1e6
    )


@dataclass(frozen=True)
class ArmLimits(Checked):
    """Limits of the commands for an arm's motors."""

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
    """Safety limits of a device with an arm."""

    recovery: str = parameter(
        AUTOMATIC,
        "recovery after missing or outdated commands: by the next valid command, or only by the"
        " service ~/arm",
        choices=(AUTOMATIC, MANUAL),
    )
    arm: ArmLimits = field(default_factory=ArmLimits)


@dataclass(frozen=True)
class MasterSafetyParameters(SafetyParameters):
    """Safety limits of a device with an arm and an actuator."""

    actuator: ActuatorCommandLimits = field(default_factory=ActuatorCommandLimits)
    hardware: ActuatorParameters = field(default_factory=ActuatorParameters)


class Watchdog:
    """Watchdog of the commands of one kind: detects missing and outdated ones.

    No commands are expected after a command of zero, with which a sender ends on purpose.

    Parameters
    ----------
    timeout, max_age : float
        Maximum time without a command and maximum age of its sample, s.
    manual : bool
        True if only `arm` lets commands through again once it has tripped.

    Attributes
    ----------
    tripped : str
        Reason for zero force; empty if there is no fault.
    timeouts : int
        Number of times that commands stopped.
    outdated : int
        Number of commands whose sample was too old, or lay in the future.
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
        """True if the next valid command is applied."""
        return not (self._manual and self.tripped)

    def admits(self, now: float, age: float) -> bool:
        """Return True if a command whose sample has an age in s may be applied now."""
        if not abs(age) <= self._max_age:  # true for NaN too
            self.outdated += 1
            # An outdated command before the first force needs no manual recovery.
            if self._heard is not None or not self._manual:
                self._trip(now, f"its sample is {age:.3g} s old")
            return False
        if self.tripped and self._manual:
            return False
        self.tripped = ""
        self._heard = now
        return True

    def went_silent(self, now: float) -> bool:
        """Return True, once, when commands have stopped."""
        if self._heard is None or now - self._heard < self._timeout:
            return False
        self.timeouts += 1
        self._trip(now, f"none for {self._timeout * 1e3:g} ms")
        return True

    def forget(self) -> None:
        """Expect no more commands until the next."""
        self._heard = None

    def rest(self) -> None:
        """Accept missing commands without a fault; a watchdog that waits for `arm` still does."""
        self.forget()
        if self.armed:
            self.tripped = ""

    def arm(self) -> None:
        """Let the next valid command through."""
        self.tripped = ""
        self.forget()

    def news(self, now: float) -> str:
        """Return a line for a lasting fault and one for its end, each once; otherwise empty."""
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
        """Return a force limited in growth, starting from the held force's part along it."""
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
        """Update the guard; return another force if the held one is no longer allowed."""
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
        """Return counts, remaining heat and travel for diagnostics."""
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
        """Return a force as limited by the guard, which may not increase or reverse it here."""
        allowed = self.guard.within(force, self._acceleration)
        if allowed * force <= 0.0:
            return 0.0
        return allowed if abs(allowed) < abs(force) else force

    def _slewed(self, now: float, force: float) -> float:
        """Return a force limited in growth, starting from zero where the sign changes."""
        most = self._slew * min(now - self._commanded, self._period)
        before = abs(self._held) if self._held * force > 0.0 else 0.0
        if abs(force) - before <= most:
            return force
        self.slewed += 1
        return math.copysign(before + most, force)

    def _hold(self, now: float, force: float) -> float:
        """Hold a force from now on, and add up the effect of the one before."""
        if self._ticked is not None:
            time = now - self._since
            self._push += self._held * time
            self._heat += self._held * self._held * time
        self._held, self._since = force, now
        return force

    def _advance(self, now: float) -> None:
        """Pass the forces since the last tick to the guard, also if that is long ago."""
        if self._ticked is None:
            self._ticked = now
            return
        elapsed = now - self._ticked
        samples = round(elapsed * self._rate)
        if samples < 1:  # two ticks for one grid point: the forces are counted with the next
            return
        mean, square = self._push / elapsed, self._heat / elapsed
        self.guard.advance(mean, self._acceleration, square=square, samples=samples)
        self._ticked, self._push, self._heat = now, 0.0, 0.0


class SafetyLayer:
    """Limits each command of a device, and replaces missing ones by zero.

    Forces are allowed once it is `enable`d, and not while it is stopped. Methods that take a
    command return the force to write, or None to leave the device as it is.

    Parameters
    ----------
    parameters : SafetyParameters
        `MasterSafetyParameters` for a device with an actuator.
    rate : float
        Ticks per second, Hz.

    Attributes
    ----------
    stopped : bool
        True while the emergency stop forbids every force.
    active : bool
        True while the device's node is active.
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
        """Reason for which every command is refused; empty if commands are accepted."""
        if self.stopped:
            return STOPPED
        return "" if self.active else INACTIVE

    @property
    def disarmed(self) -> str:
        """Forces that wait for `arm`, with the reason; empty for none."""
        waiting = [c for c in self._channels if not c.watchdog.armed]
        return ", ".join(f"{c.name}: {c.watchdog.tripped}" for c in waiting)

    def arm_force(self, now: float, age: float, force: Vector) -> Vector | None:
        """Return the arm's force for a command, N, whose sample has an age in s; None for none."""
        if self.stopped or not self.active:
            return None
        return self._arm.command(now, age, force)

    def actuator_force(self, now: float, age: float, force: float) -> float | None:
        """Return the actuator's force for a command, as `arm_force` does for the arm."""
        if self.stopped or not self.active or self._actuator is None:
            return None
        return self._actuator.command(now, age, force)

    def tick(
        self, now: float, handle_acceleration: float | None = None
    ) -> tuple[Vector | None, float | None]:
        """Return new forces for arm and actuator where the held ones must end; once a period.

        Parameters
        ----------
        now : float
            Time, s.
        handle_acceleration : float, optional
            Latest measurement, m/s^2; None where it is missing.
        """
        arm = self._arm.tick(now)
        if self._actuator is None:
            return arm, None
        return arm, self._actuator.tick(now, handle_acceleration)

    def stop(self, now: float, stopped: bool) -> None:
        """Forbid forces, or release the stop; the caller sets present forces to zero."""
        self.stopped = stopped
        self._let_go(now)

    def enable(self, now: float, active: bool) -> None:
        """Allow or forbid forces; the caller sets present forces to zero."""
        self.active = active
        self._let_go(now)
        if active:
            self.arm()

    def arm(self) -> str:
        """Allow forces after missing or outdated commands; return the reason if refused."""
        if self.refusal:
            return self.refusal
        for channel in self._channels:
            channel.watchdog.arm()
        return ""

    def news(self, now: float) -> list[str]:
        """Return lines for the log, each once."""
        told = ((c.name, c.watchdog.news(now)) for c in self._channels)
        return [f"{name}: {line}" for name, line in told if line]

    def warnings(self) -> list[str]:
        """Return present faults, and those that occurred since the last call."""
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
        """Return counts and the state of the actuator's limits for diagnostics."""
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
