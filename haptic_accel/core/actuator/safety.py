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

"""Safety layer between commands and devices, simulated devices included.

The layer only reduces forces: the applied force lies between zero and the command. It does not
rely on the compensator. The compensator limits the actuator too, because a controller must know
the applied force, but the device must be safe with any compensator and without one. The layer's
limits lie outside the compensator's (`HARD` and `COMFORT` of `core.actuator.guard`), so that only
one guard acts.

The layer has no clock: the caller passes times in s from any origin, which never decrease.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from haptic_accel.core.actuator.guard import HARD, ActuatorGuard, scaled_within
from haptic_accel.core.actuator.parameters import ActuatorParameters
from haptic_accel.core.actuator.travel import LARGEST_ACCELERATION
from haptic_accel.core.axes import ACTUATOR_AXES, NAMES, Axes
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.parameters import Checked, parameter

ACTUATOR_TIMEOUT = 5e-3
"""Default time-out of the actuator's commands, s: five periods of the paper's loop."""

ARM_TIMEOUT = 20e-3
"""Default time-out of an arm's commands, s: a hand moves millimetres in that time."""

LEAST_PERIODS = 2.5
"""Minimum time-out in periods, so that one lost command does not trip the watchdog."""

MAX_AGE = 0.1
"""Default maximum age of a command's sample, s; also the maximum clock difference."""

ARM_PEAK_FORCE = 3.3
"""Maximum force of a Phantom Omni (data sheet), N."""

LASTING = 0.5
"""Duration above which missing commands are logged, s: shorter interruptions are only counted."""

ROUNDING = 1e-9
"""Relative excess of a force over its limit that counts as a rounding error."""

HELD, LAST = "held (N)", "last given (N)"
"""Present force in diagnostics, after the name of its command; of a faulty device, the force that
it was last given, applied or not."""

AUTOMATIC, MANUAL = "automatic", "manual"

GONE = "still missing"
"""Warning for commands that stopped before the last report and are still missing."""

STOPPED = "emergency stop"
"""Reason for zero force while the emergency stop is not released."""

INACTIVE = "not active"
"""Reason for zero force while the device's node is not active."""


def _timeout(default: float) -> Any:
    meaning = f"time without a command after which the force is zero; {LEAST_PERIODS:g} periods"
    return parameter(default, f"{meaning} at least", "s", 1e-3, 10.0)


@dataclass(frozen=True)
class ActuatorCommandLimits(Checked):
    """Limits of the actuator's commands, in addition to the actuator's own limits."""

    command_timeout: float = _timeout(ACTUATOR_TIMEOUT)
    max_age: float = parameter(
        MAX_AGE,
        "maximum age of the sample that caused a command, and maximum lead of its stamp;"
        " beyond, the force is zero",
        "s",
        1e-3,
        10.0,
    )
    slew_rate: float = parameter(
        0.0, "maximum rate of growth of the force; 0 for no limit", "N/s", 0, 1e6
    )


@dataclass(frozen=True)
class ArmLimits(ActuatorCommandLimits):
    """Limits of the commands for an arm's motors."""

    command_timeout: float = _timeout(ARM_TIMEOUT)
    peak_force: float = parameter(
        ARM_PEAK_FORCE, "limit of the arm's force (Phantom Omni: 3.3 N)", "N", 0, 100
    )
    zero_stamp: bool = parameter(
        True, "accept a command without a stamp, which CRTK allows, as caused at its arrival"
    )


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
    """Watchdog for one kind of command: detects missing and outdated commands.

    A sender's last command is zero; no commands are expected afterwards.

    Parameters
    ----------
    timeout, max_age : float
        Maximum time without a command and maximum age of its sample, s.
    manual : bool
        True if only `arm` accepts commands again after a fault.

    Attributes
    ----------
    tripped : str
        Reason for zero force; empty if there is no fault.
    timeouts : int
        Number of interruptions of the commands.
    outdated : int
        Number of commands whose sample was too old, or from the future.
    """

    def __init__(self, timeout: float, max_age: float, *, manual: bool) -> None:
        self._timeout = timeout
        self._max_age = max_age
        self._manual = manual
        self._latest: float | None = None
        self._tripped_at = 0.0
        self._logged = False
        self.tripped = ""
        self.timeouts = self.outdated = 0

    @property
    def armed(self) -> bool:
        """True if the next valid command is applied."""
        return not (self._manual and self.tripped)

    def admits(self, now: float, age: float) -> bool:
        """Return True if a command with a sample of this age, s, may be applied."""
        if not abs(age) <= self._max_age:  # also true for NaN
            self.outdated += 1
            # An outdated command before the first force needs no manual recovery.
            if self._latest is not None or not self._manual:
                self._trip(now, f"its sample is {age:.3g} s old")
            return False
        if self.tripped and self._manual:
            return False
        self.tripped = ""
        self._latest = now
        return True

    def expired(self, now: float) -> bool:
        """Return True, once, when commands have stopped."""
        if self._latest is None or now - self._latest < self._timeout:
            return False
        self.timeouts += 1
        self._trip(now, f"none for {self._timeout * 1e3:g} ms")
        return True

    def forget(self) -> None:
        """Expect no command until the next one."""
        self._latest = None

    def rest(self) -> None:
        """Treat missing commands as no fault; a watchdog that waits for `arm` still waits."""
        self.forget()
        if self.armed:
            self.tripped = ""

    def arm(self) -> None:
        """Accept the next valid command; time since the last command still counts."""
        self.tripped = ""

    def news(self, now: float) -> str:
        """Return a log line at the start and end of a lasting fault; otherwise empty."""
        if self.tripped and not self._logged:
            if not self.armed or now - self._tripped_at > LASTING:
                self._logged = True
                end = "the next" if self.armed else "armed again"
                return f"{self.tripped}; no force until {end}"
        elif self._logged and not self.tripped:
            self._logged = False
            return "allowed again"
        return ""

    def _trip(self, now: float, reason: str) -> None:
        if not self.tripped:
            self._tripped_at = now
            self.tripped = reason
        self.forget()


class _Channel(ABC):
    """Common checks of the commands for arm and actuator."""

    name: ClassVar[str]

    def __init__(self, limits: ActuatorCommandLimits, rate: float, *, manual: bool) -> None:
        timeout = max(limits.command_timeout, LEAST_PERIODS / rate)
        self.watchdog = Watchdog(timeout, limits.max_age, manual=manual)
        self._slew = limits.slew_rate
        self._period = 1.0 / rate
        self._held = ZERO
        self._commanded = -math.inf
        self._told, self._before, self.contested = False, "", ""
        self.rejected = self.slewed = 0

    def command(self, now: float, age: float, force: Vector) -> Vector | None:
        """Return the force to write for a command, or None for no change."""
        magnitude = self._magnitude(force)
        if not math.isfinite(magnitude):
            self.rejected += 1
            return None
        if self.contested:
            return self.contend(now)
        if not self.watchdog.admits(now, age):
            return self.let_go(now) if self._held != ZERO else None
        force = self._limited(now, force, magnitude)
        self._commanded = now
        return self._hold(now, force)

    def contend(self, now: float) -> Vector | None:
        """Apply no force while several publishers send commands; count none as missed."""
        self.watchdog.rest()
        return self.let_go(now) if self._held != ZERO else None

    def let_go(self, now: float) -> Vector:
        """Apply no force from now on; return zero."""
        self._commanded = now
        return self._hold(now, ZERO)

    @property
    def held(self) -> Vector:
        """Present force, N."""
        return self._held

    def news(self, now: float) -> str:
        """Return a line for the log, once; otherwise empty."""
        news = self.watchdog.news(now)
        # Senders' names are known later than their number.
        settled, self._before = self.contested == self._before, self.contested
        if settled and bool(self.contested) != self._told:
            self._told = bool(self.contested)
            return self.contested or "allowed again: it has one sender"
        return "" if self.contested else news

    def values(self) -> dict[str, str]:
        """Return the present force and counts for diagnostics."""
        return {
            HELD: f"{self._magnitude(self._held):.3f}",
            "rejected": str(self.rejected),
            "timeouts": str(self.watchdog.timeouts),
            "outdated": str(self.watchdog.outdated),
            "slewed": str(self.slewed),
        }

    def _growth(self, now: float) -> float:
        """Return the maximum growth of the force since the last command, N.

        A tick's time may precede the time of a request processed meanwhile.
        """
        return self._slew * max(0.0, min(now - self._commanded, self._period))

    def _hold(self, now: float, force: Vector) -> Vector:
        """Apply a force from now on; return it."""
        self._held = force
        return force

    @abstractmethod
    def _limited(self, now: float, force: Vector, magnitude: float) -> Vector: ...

    def _magnitude(self, force: Vector) -> float:
        x, y, z = force
        return math.sqrt(x * x + y * y + z * z)

    def _slewed(self, now: float, force: Vector) -> Vector:
        """Return a force limited in growth from the present force in its direction."""
        most = self._growth(now)
        magnitude = math.hypot(*force)
        if magnitude <= most:
            return force
        x, y, z = force
        direction = x / magnitude, y / magnitude, z / magnitude
        along = sum(a * b for a, b in zip(self._held, direction, strict=True))
        before = max(0.0, along)
        if magnitude - before <= most:
            return force
        self.slewed += 1
        return _scaled(direction, before + most)


class _ArmChannel(_Channel):
    """The commands for an arm."""

    name = "arm force"

    def __init__(self, limits: ArmLimits, rate: float, *, manual: bool) -> None:
        super().__init__(limits, rate, manual=manual)
        self._peak = limits.peak_force
        self.limited = 0

    def tick(self, now: float) -> Vector | None:
        if self.contested:
            return self.contend(now)
        return self.let_go(now) if self.watchdog.expired(now) else None

    def values(self) -> dict[str, str]:
        """Return counts for diagnostics."""
        return {**super().values(), "limited": str(self.limited)}

    def _limited(self, now: float, force: Vector, magnitude: float) -> Vector:
        if magnitude > self._peak:
            if magnitude > self._peak * (1.0 + ROUNDING):
                self.limited += 1
            force = _scaled(force, self._peak / magnitude)
        if self._slew:
            force = self._slewed(now, force)
        if force == ZERO:
            self.watchdog.forget()
        return force


class _Coil:
    """Guard of one coil, with the forces that have acted since its last update."""

    def __init__(self, parameters: MasterSafetyParameters, rate: float) -> None:
        self.guard = ActuatorGuard(parameters.hardware, rate, HARD)
        self._rate = rate
        self._acceleration = self._held = 0.0
        self._ticked: float | None = None
        self._push = self._heat = 0.0
        self._since = -math.inf

    def advance(self, now: float, handle_acceleration: float | None) -> None:
        """Pass the forces since the last tick to the guard, even after a long pause."""
        if handle_acceleration is not None and abs(handle_acceleration) <= LARGEST_ACCELERATION:
            self._acceleration = handle_acceleration
        self.hold(now, self._held)
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

    def allowed(self, force: float) -> float:
        """Return the force that the guard allows in place of a requested one, N."""
        return self.guard.within(force, self._acceleration)

    def hold(self, now: float, force: float) -> None:
        """Apply a new force, and integrate the effect of the previous force."""
        if self._ticked is not None:
            time = now - self._since
            self._push += self._held * time
            self._heat += self._held * self._held * time
        self._since = now
        self._held = force


class _ActuatorChannel(_Channel):
    """The commands for an actuator with n coils.

    If a coil reaches a limit, the force on all is scaled and keeps its direction.
    """

    name = "actuator force"

    def __init__(
        self, parameters: MasterSafetyParameters, rate: float, axes: Axes, *, manual: bool
    ) -> None:
        super().__init__(parameters.actuator, rate, manual=manual)
        self._axes = axes
        self._has_coil = tuple(name in axes.names for name in NAMES)
        self._coils = [(index, _Coil(parameters, rate)) for index in axes.indices]

    def command(self, now: float, age: float, force: Vector) -> Vector | None:
        """Return the force to write for a command; components without a coil are zero."""
        has_x, has_y, has_z = self._has_coil
        x, y, z = force
        force = x if has_x else 0.0, y if has_y else 0.0, z if has_z else 0.0
        return super().command(now, age, force)

    def tick(self, now: float, handle_acceleration: Vector | None) -> Vector | None:
        """Update the guards; return a new force if the present force must be reduced."""
        for index, coil in self._coils:
            coil.advance(now, handle_acceleration[index] if handle_acceleration else None)
        if self.contested:
            return self.contend(now)
        if self.watchdog.expired(now):
            return self.let_go(now)
        held = self._held
        if held == ZERO:
            return None
        force = self._within(held)
        return None if force == held else self._hold(now, force)

    def values(self) -> dict[str, str]:
        """Return counts of all coils, least remaining heat and largest travel for diagnostics."""
        return super().values() | _limits_reached([coil.guard for _, coil in self._coils])

    def _magnitude(self, force: Vector) -> float:
        return math.hypot(*force)  # that of a single component exactly

    def _limited(self, now: float, force: Vector, magnitude: float) -> Vector:
        if self._slew:
            force = self._slewed(now, force)
        if force == ZERO:
            self.watchdog.forget()
            return force
        return self._within(force)

    def _within(self, force: Vector) -> Vector:
        """Return a force limited by all guards, without an increase or change of direction."""
        allowed, is_less = [], False
        for index, coil in self._coils:
            most = coil.allowed(force[index])
            allowed.append(most)
            is_less |= most != force[index]
        if not is_less:
            return force
        forces = self._axes.components(force)
        return self._axes.vector(scaled_within(forces, allowed))

    def _hold(self, now: float, force: Vector) -> Vector:
        for index, coil in self._coils:
            coil.hold(now, force[index])
        self._held = force
        return force


class SafetyLayer:
    """Limit the commands of a device; replace missing commands by zero.

    Forces are allowed after `enable`, except while `stopped`. Methods that take a command return
    the force to write, or None for no change.

    Parameters
    ----------
    parameters : SafetyParameters
        `MasterSafetyParameters` for a device with an actuator.
    rate : float
        Ticks per second, Hz.
    axes : Axes
        Axes of the actuator's coils; other components of its commands are ignored.

    Attributes
    ----------
    stopped : bool
        True while the emergency stop forbids every force.
    active : bool
        True while the device's node is active.
    refusal : str
        Reason for which every command is rejected; empty if commands are accepted.
    """

    def __init__(
        self, parameters: SafetyParameters, rate: float, axes: Axes = ACTUATOR_AXES
    ) -> None:
        manual = parameters.recovery == MANUAL
        self._arm = _ArmChannel(parameters.arm, rate, manual=manual)
        self._actuator: _ActuatorChannel | None = None
        self._channels: list[_Channel] = [self._arm]
        if isinstance(parameters, MasterSafetyParameters):
            self._actuator = _ActuatorChannel(parameters, rate, axes, manual=manual)
            self._channels.append(self._actuator)
        self._warned: defaultdict[str, int] = defaultdict(int)
        self.stopped = self.active = False
        self.refusal = INACTIVE

    @property
    def held_arm_force(self) -> Vector:
        """Force of the arm since the last command, N."""
        return self._arm.held

    @property
    def disarmed(self) -> str:
        """Reason why forces are blocked until `arm` is called; empty if they are not blocked."""
        waiting = [c for c in self._channels if not c.watchdog.armed]
        return ", ".join(f"{c.name}: {c.watchdog.tripped}" for c in waiting)

    @property
    def contested(self) -> str:
        """Forces whose commands are rejected because several senders send them; empty if none."""
        return ", ".join(f"{c.name}: {c.contested}" for c in self._channels if c.contested)

    def note_rivals(self, force: str, rivals: str) -> None:
        """Reject commands for ``arm force`` or ``actuator force`` while there are several senders.

        Parameters
        ----------
        force : str
        rivals : str
            Names of the senders; empty for a single one.
        """
        refused = f"no force while it is sent by {rivals}" if rivals else ""
        for channel in self._channels:
            if channel.name == force:
                channel.contested = refused

    def arm_force(self, now: float, age: float, force: Vector) -> Vector | None:
        """Return the arm's force, N, for a command with a sample age in s; None for no change."""
        return None if self.refusal else self._arm.command(now, age, force)

    def actuator_force(self, now: float, age: float, force: Vector) -> Vector | None:
        """Return the actuator's force for a command; see `arm_force`."""
        if self.refusal or not self._actuator:
            return None
        return self._actuator.command(now, age, force)

    def tick(
        self, now: float, handle_acceleration: Vector | None = None
    ) -> tuple[Vector | None, Vector | None]:
        """Return new arm and actuator forces if the present forces must end; once per period.

        Parameters
        ----------
        now : float
            Time, s.
        handle_acceleration : tuple of float, optional
            Latest measurement, m/s^2; None if it is missing.
        """
        arm = self._arm.tick(now)
        return arm, self._actuator.tick(now, handle_acceleration) if self._actuator else None

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
        """Allow forces after missing or outdated commands; return the reason for a rejection."""
        if self.refusal:
            return self.refusal
        for channel in self._channels:
            channel.watchdog.arm()
        return ""

    def news(self, now: float) -> list[str]:
        """Return lines for the log, each once."""
        lines = ((c.name, c.news(now)) for c in self._channels)
        return [f"{name}: {line}" for name, line in lines if line]

    def warnings(self) -> list[str]:
        """Return all faults, present or since the last call."""
        found = [self.refusal] if self.refusal else []
        if self.disarmed:
            found.append(f"not armed: {self.disarmed}")
        if self.contested:
            found.append(self.contested)
        for channel in self._channels:
            watchdog = channel.watchdog
            counts = {
                f"{channel.name} timed out": watchdog.timeouts,
                f"{channel.name} out of date": watchdog.outdated,
                f"{channel.name} not finite": channel.rejected,
            }
            new = [fault for fault, count in counts.items() if count > self._warned[fault]]
            self._warned.update(counts)
            if not new and watchdog.tripped and watchdog.armed:
                new = [f"{channel.name} {GONE}"]
            found += new
        return found

    def diagnostics(self, fault: str = "") -> dict[str, str]:
        """Return counts and the state of the actuator's limits for diagnostics.

        Parameters
        ----------
        fault : str
            Reason for which a part of the device applies no command, as of a board that has
            disarmed; empty for none. No force is then called held.
        """
        refused = fault or self.refusal or self.disarmed or self.contested
        values = {"forces allowed": str(not refused).lower()}
        for channel in self._channels:
            for name, value in channel.values().items():
                told = LAST if fault and name == HELD else name
                values[f"{channel.name} {told}"] = value
        return values

    def _let_go(self, now: float) -> None:
        """Set all forces to zero after a change of the conditions for forces."""
        self.refusal = STOPPED if self.stopped else "" if self.active else INACTIVE
        for channel in self._channels:
            channel.let_go(now)
            channel.watchdog.rest()


def _scaled(force: Vector, share: float) -> Vector:
    x, y, z = force
    return x * share, y * share, z * share


def _limits_reached(guards: Sequence[ActuatorGuard]) -> dict[str, str]:
    """Return counts of all coils, the least remaining heat and the largest travel."""
    travel = max((guard.travel for guard in guards), key=abs)
    heat = max(guard.heat for guard in guards)
    return {
        "limited": str(sum(guard.saturated for guard in guards)),
        "limited by heat": str(sum(guard.heated for guard in guards)),
        "limited by travel": str(sum(guard.cushioned for guard in guards)),
        "heat left (%)": f"{100.0 * max(0.0, 1.0 - heat):.1f}",
        "travel (mm)": f"{1e3 * travel:.2f}",
    }
