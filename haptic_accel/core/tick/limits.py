# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Safety layer between commands and devices, simulated devices included.

The layer only reduces forces: the applied force lies between zero and the command. It does not
rely on the compensator. The compensator limits the actuator too, because a controller must know
the applied force, but the device must be safe with any compensator and without one. The layer's
limits lie outside the compensator's (`HARD` of the guard), so that only one guard acts.

The layer has no clock: the caller passes times in s from any origin, which never decrease.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from haptic_accel.core.tick.guard import ActuatorGuard, Coil, scale_within

if TYPE_CHECKING:
    from haptic_accel.core.actuator import (
        ActuatorCommandLimits,
        ArmLimits,
        MasterSafetyParameters,
        SafetyParameters,
    )
    from haptic_accel.core.axes import Axes

FORCE_ROUNDING: float = 1e-9
"""Relative excess of a force over its limit that counts as a rounding error."""

LOGGED_AFTER: float = 0.5
"""Duration above which missing commands are logged, s: shorter interruptions are only counted."""

HELD_FORCE: str = "held (N)"
"""Name of the present force in diagnostics, after the name of its command."""

LAST_FORCE: str = "last given (N)"
"""The same for a faulty device: the force that it received last, applied or not."""

STILL_MISSING: str = "still missing"
"""Warning for commands that stopped before the last report and are still missing."""

STOPPED: str = "emergency stop"
"""Reason for zero force while the emergency stop is not released."""

NOT_ACTIVE: str = "not active"
"""Reason for zero force while the device's node is not active."""


class ForceLimit:
    """Limit of one force of a device, with checks of its commands; it holds the present force.

    Its watchdog detects missing and outdated commands. A sender's last command is zero; no
    commands are expected afterwards.

    Parameters
    ----------
    name : str
    limits : ActuatorCommandLimits
    rate : float
        Ticks per second, Hz.
    manual : bool
        True if only `SafetyLayer.arm` enables commands again after a fault of their sender.

    Attributes
    ----------
    x, y, z : float
        Present force, N.
    refused : bool
        True while every command is rejected.
    contested : str
        Reason why commands of several senders are rejected; empty for a single sender.
    tripped : str
        Reason for zero force: missing or outdated commands. Empty after the next valid one or,
        with manual recovery, after `SafetyLayer.arm`.
    timeouts : int
        Number of interruptions of the commands.
    outdated : int
        Number of commands whose sample was too old, or from the future.
    rejected : int
        Number of commands that were not finite.
    slewed : int
        Number of commands that grew faster than allowed.
    """

    def __init__(
        self, name: str, limits: ActuatorCommandLimits, rate: float, manual: bool
    ) -> None:
        from haptic_accel.core.actuator import LEAST_PERIODS

        self.name: str = name
        self._timeout: float = max(limits.command_timeout, LEAST_PERIODS / rate)
        self._max_age: float = limits.max_age
        self._slew: float = limits.slew_rate
        self._period: float = 1.0 / rate
        self._manual: bool = manual
        self.x = self.y = self.z = 0.0
        self._expecting = False
        self._commanded = self._latest = self._tripped_at = 0.0
        self.tripped: str = ""
        self.refused = True
        self.contested: str = ""
        self.timeouts = self.outdated = self.rejected = self.slewed = 0
        # Faults that have been logged and reported.
        self._logged = self._contest_logged = False
        self._before: str = ""
        self._reported: dict[str, int] = {}

    # Each command and each tick

    def accepts(self, now: float, age: float, x: float, y: float, z: float) -> bool:
        """Hold the force of a command, unless its sample is outdated or its sender not trusted.

        The force may grow, in its direction, from the present one by what the slew rate allows
        within a period. The time of a tick may precede that of a request processed meanwhile.
        """
        if self.contested:
            self.rest()
            return False
        if not -self._max_age <= age <= self._max_age:  # also true for NaN
            self.outdated += 1
            # An outdated command before the first force needs no manual recovery.
            if self._expecting or not self._manual:
                self.trip(now, f"its sample is {age:.3g} s old")
            return False
        if self.tripped and self._manual:
            return False
        self.tripped = ""
        if self._slew > 0.0:
            magnitude: float = math.hypot(x, y, z)
            most = self._slew * max(0.0, min(now - self._commanded, self._period))
            if magnitude > most:
                u_x, u_y, u_z = x / magnitude, y / magnitude, z / magnitude
                before = max(0.0, self.x * u_x + self.y * u_y + self.z * u_z)
                if magnitude - before > most:
                    self.slewed += 1
                    most += before
                    x, y, z = u_x * most, u_y * most, u_z * most
        self.x, self.y, self.z = x, y, z
        self._latest = self._commanded = now
        # The last command of a sender is zero.
        self._expecting = x != 0.0 or y != 0.0 or z != 0.0
        return True

    def expires(self, now: float) -> bool:
        """End the force if its commands have stopped or are contested; return True if it ended."""
        if self.contested:
            self.rest()
            return self.end(now)
        if not self._expecting or now - self._latest < self._timeout:
            return False
        self.timeouts += 1
        self.trip(now, f"none for {self._timeout * 1e3:g} ms")
        self.let_go(now)
        return True

    def trip(self, now: float, reason: str) -> None:
        """Record a fault of the sender, and expect no command until the next one."""
        if not self.tripped:
            self.tripped = reason
            self._tripped_at = now
        self._expecting = False

    def end(self, now: float) -> bool:
        """Apply no force from now on; return True if there was one."""
        if self.x == 0.0 and self.y == 0.0 and self.z == 0.0:
            return False
        self.let_go(now)
        return True

    def let_go(self, now: float) -> None:
        """Apply no force from now on."""
        self._commanded = now
        self.x = self.y = self.z = 0.0

    def rest(self) -> None:
        """Do not count missing commands as a fault; manual recovery is still required."""
        self._expecting = False
        if not self._manual:
            self.tripped = ""

    # Events, at their own times

    def is_disarmed(self) -> bool:
        """Return True if only `SafetyLayer.arm` accepts commands again."""
        return self._manual and self.tripped != ""

    def news(self, now: float) -> str:
        """Return a log line, each event once; otherwise empty."""
        news = self._fault_news(now)
        # The senders' names become known later than their number.
        settled, self._before = self.contested == self._before, self.contested
        if settled and bool(self.contested) != self._contest_logged:
            self._contest_logged = bool(self.contested)
            return self.contested or "allowed again: it has one sender"
        return "" if self.contested else news

    def _fault_news(self, now: float) -> str:
        """Return a log line at the start and end of a lasting fault; otherwise empty."""
        if self.tripped and not self._logged:
            if self._manual or now - self._tripped_at > LOGGED_AFTER:
                self._logged = True
                end = "armed again" if self._manual else "the next"
                return f"{self.tripped}; no force until {end}"
        elif self._logged and not self.tripped:
            self._logged = False
            return "allowed again"
        return ""

    def warnings(self) -> list[str]:
        """Return the faults since the last call, and commands that are still missing."""
        counts = {
            f"{self.name} timed out": self.timeouts,
            f"{self.name} out of date": self.outdated,
            f"{self.name} not finite": self.rejected,
        }
        new = [fault for fault, count in counts.items() if count > self._reported.get(fault, 0)]
        self._reported = counts
        if not new and self.tripped and not self._manual:
            return [f"{self.name} {STILL_MISSING}"]
        return new

    def values(self, fault: str) -> dict[str, str]:
        """Return the present force and counts for diagnostics; see `SafetyLayer.diagnostics`."""
        name = LAST_FORCE if fault else HELD_FORCE
        return {
            name: f"{math.sqrt(self.x * self.x + self.y * self.y + self.z * self.z):.3f}",
            "rejected": str(self.rejected),
            "timeouts": str(self.timeouts),
            "outdated": str(self.outdated),
            "slewed": str(self.slewed),
        }


class ArmLimit(ForceLimit):
    """Limit of an arm's force; parameters as for `ForceLimit`.

    Attributes
    ----------
    limited : int
        Number of commands above the peak force.
    """

    def __init__(self, limits: ArmLimits, rate: float, manual: bool) -> None:
        super().__init__("arm force", limits, rate, manual)
        self._peak: float = limits.peak_force
        self.limited = 0

    def command(self, now: float, age: float, x: float, y: float, z: float) -> bool:
        """Apply a command; return True if the device must receive `x`, `y` and `z`.

        Parameters
        ----------
        now : float
            Time, s.
        age : float
            Age of the sample that caused the command, s.
        x, y, z : float
            Force, N.
        """
        if self.refused:
            return False
        magnitude = math.sqrt(x * x + y * y + z * z)
        if not math.isfinite(magnitude):
            self.rejected += 1
            return False
        if magnitude > self._peak:
            share = self._peak / magnitude
            x, y, z = x * share, y * share, z * share
        if not self.accepts(now, age, x, y, z):
            return self.end(now)
        if magnitude > self._peak * (1.0 + FORCE_ROUNDING):
            self.limited += 1
        return True

    def values(self, fault: str) -> dict[str, str]:
        """Return the present force and counts for diagnostics."""
        return {**super().values(fault), "limited": str(self.limited)}


class ActuatorLimit(ForceLimit):
    """Limit of the force of an actuator with n coils; parameters as for `ForceLimit`.

    If a coil reaches a limit, the force on all is scaled and keeps its direction.

    Attributes
    ----------
    coils : list of Coil
    """

    def __init__(
        self, parameters: MasterSafetyParameters, rate: float, axes: Axes, manual: bool
    ) -> None:
        super().__init__("actuator force", parameters.actuator, rate, manual)
        self.coils: list[Coil] = [Coil(parameters.hardware, rate, index) for index in axes.indices]
        self._guards: list[ActuatorGuard] = [*self.coils]
        self._has_x: bool = 0 in axes.indices
        self._has_y: bool = 1 in axes.indices
        self._has_z: bool = 2 in axes.indices

    def command(self, now: float, age: float, x: float, y: float, z: float) -> bool:
        """Apply a command like `ArmLimit.command`; components without a coil are zero."""
        if self.refused:
            return False
        x, y, z = x if self._has_x else 0.0, y if self._has_y else 0.0, z if self._has_z else 0.0
        if not math.isfinite(x + y + z):
            self.rejected += 1
            return False
        if not self.accepts(now, age, x, y, z):
            return self.end(now)
        if self._expecting:  # a force that is not zero
            self.reduce()
        self.hold(now)
        return True

    def tick(self, now: float, known: bool, a_x: float, a_y: float, a_z: float) -> bool:
        """Update the guards, and end or reduce the present force; return True if it changed.

        Parameters
        ----------
        now : float
            Time, s.
        known : bool
            False if the measurement is missing.
        a_x, a_y, a_z : float
            Latest measured acceleration of the handle, m/s^2.
        """
        for coil in self.coils:
            coil.tick(now, known, a_x if coil.axis == 0 else a_y if coil.axis == 1 else a_z)
        if self.expires(now):
            return True
        if (self.x == 0.0 and self.y == 0.0 and self.z == 0.0) or not self.reduce():
            return False
        self.hold(now)
        return True

    def reduce(self) -> bool:
        """Reduce the present force to what all guards allow; return True if it became smaller.

        It is never increased, and its direction does not change.
        """
        is_free = True
        for coil in self.coils:
            force = self.x if coil.axis == 0 else self.y if coil.axis == 1 else self.z
            allowed = coil.within(force, coil.acceleration)
            coil.requested = force
            coil.allowed = allowed
            if allowed != force:
                is_free = False
        if is_free:
            return False
        scale_within(self._guards)
        is_less = False
        for coil in self.coils:
            if coil.allowed != coil.requested:
                is_less = True
            if coil.axis == 0:
                self.x = coil.allowed
            elif coil.axis == 1:
                self.y = coil.allowed
            else:
                self.z = coil.allowed
        return is_less

    def hold(self, now: float) -> None:
        """Apply the present force to the coils from now on."""
        for coil in self.coils:
            coil.hold(now, self.x if coil.axis == 0 else self.y if coil.axis == 1 else self.z)

    def let_go(self, now: float) -> None:
        """Apply no force from now on."""
        self._commanded = now
        self.x = self.y = self.z = 0.0
        self.hold(now)

    def values(self, fault: str) -> dict[str, str]:
        """Return counts of all coils, least remaining heat and largest travel for diagnostics."""
        coils = self.coils
        heat = max([coil.heat_share() for coil in coils])
        travel = max([coil.travel for coil in coils], key=abs)
        return {
            **super().values(fault),
            "limited": str(sum([coil.saturated for coil in coils])),
            "limited by heat": str(sum([coil.heated for coil in coils])),
            "limited by travel": str(sum([coil.cushioned for coil in coils])),
            "heat left (%)": f"{100.0 * max(0.0, 1.0 - heat):.1f}",
            "travel (mm)": f"{1e3 * travel:.2f}",
        }


class SafetyLayer:
    """Limit the commands of a device; replace missing commands by zero.

    Forces are allowed after `enable`, except while `stopped`. Each command goes to
    `arm_limit.command` or `actuator_limit.command`. Once per period, before the next commands,
    `arm_limit.expires` and `actuator_limit.tick` end forces that have lasted too long. After each
    of these calls that returns True, the device must receive the limit's force.

    Parameters
    ----------
    parameters : SafetyParameters
        `MasterSafetyParameters` for a device with an actuator.
    rate : float
        Ticks per second, Hz.
    axes : Axes, optional
        Axes of the actuator's coils; other components of its commands are ignored. Default: z.

    Attributes
    ----------
    arm_limit : ArmLimit
    actuator_limit : ActuatorLimit or None
        None for a device without an actuator.
    stopped : bool
        True while the emergency stop forbids every force.
    active : bool
        True while the device's node is active.
    refusal : str
        Reason why all commands are rejected; empty if commands are accepted.
    """

    def __init__(
        self, parameters: SafetyParameters, rate: float, axes: Axes | None = None
    ) -> None:
        from haptic_accel.core.actuator import MANUAL, MasterSafetyParameters
        from haptic_accel.core.axes import ACTUATOR_AXES

        manual = parameters.recovery == MANUAL
        self.arm_limit = ArmLimit(parameters.arm, rate, manual)
        self.actuator_limit: ActuatorLimit | None = None
        self._limits: list[ForceLimit] = [self.arm_limit]
        if isinstance(parameters, MasterSafetyParameters):
            self.actuator_limit = ActuatorLimit(parameters, rate, axes or ACTUATOR_AXES, manual)
            self._limits.append(self.actuator_limit)
        self.stopped = self.active = False
        self.refusal: str = NOT_ACTIVE

    @property
    def disarmed(self) -> str:
        """Reason why forces are blocked until `arm` is called; empty if they are not blocked."""
        found = [each for each in self._limits if each.is_disarmed()]
        return ", ".join([f"{each.name}: {each.tripped}" for each in found])

    @property
    def contested(self) -> str:
        """Forces whose commands are rejected because several senders send them; empty if none."""
        found = [each for each in self._limits if each.contested]
        return ", ".join([f"{each.name}: {each.contested}" for each in found])

    def note_rivals(self, force: str, rivals: str) -> None:
        """Reject commands for ``arm force`` or ``actuator force`` while there are several senders.

        Parameters
        ----------
        force : str
        rivals : str
            Names of the senders; empty for a single one.
        """
        for each in self._limits:
            if each.name == force:
                each.contested = f"no force while it is sent by {rivals}" if rivals else ""

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
        if not self.refusal:
            for each in self._limits:
                each.tripped = ""  # time since the last command still counts
        return self.refusal

    def news(self, now: float) -> list[str]:
        """Return log lines, each event once."""
        lines = [(each.name, each.news(now)) for each in self._limits]
        return [f"{name}: {line}" for name, line in lines if line]

    def warnings(self) -> list[str]:
        """Return all faults, present or since the last call."""
        found = [self.refusal] if self.refusal else []
        if self.disarmed:
            found.append(f"not armed: {self.disarmed}")
        if self.contested:
            found.append(self.contested)
        for each in self._limits:
            found += each.warnings()
        return found

    def diagnostics(self, fault: str = "") -> dict[str, str]:
        """Return counts and the state of the actuator's limits for diagnostics.

        Parameters
        ----------
        fault : str
            Reason why a part of the device applies no command, for example a board that has
            disarmed; empty if there is none. With a fault, no force is reported as held.
        """
        refused = fault or self.refusal or self.disarmed or self.contested
        values = {"forces allowed": str(not refused).lower()}
        for each in self._limits:
            values |= {f"{each.name} {name}": value for name, value in each.values(fault).items()}
        return values

    def _let_go(self, now: float) -> None:
        """Set all forces to zero after a change of the conditions for forces."""
        self.refusal = STOPPED if self.stopped else "" if self.active else NOT_ACTIVE
        for each in self._limits:
            each.refused = self.refusal != ""
            each.let_go(now)
            each.rest()
