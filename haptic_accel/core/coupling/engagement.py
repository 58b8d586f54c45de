# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The decision when the two arms are coupled: engage, release, take again, end.

It has no clock: times are the caller's, in s from any origin and never backwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_accel.core.actuator.safety import AUTOMATIC, MANUAL
from haptic_accel.core.emergency_stop import EmergencyStop
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.topics import ARMS

STEP_PERIOD = 0.02
"""Interval at which `Engagement.step` is due, s."""

WARNING_PERIOD = 5.0
"""Interval between "waiting for ..." warnings, s."""

FREE_TIME = 0.5
"""Minimum time for which released arms stay free, s: where they are when they are taken again
becomes each other's counterpart, so they must have come to rest; those of the virtual rig have
been put back to their start by then."""

RESTING = "waiting for the arms to come to rest"
"""Reason for free arms soon after they were released."""

STOPPED = "emergency stop"
"""Reason for free arms while the emergency stop is not released."""

DIFFERING = 0.5
"""Time for which a device and the coupler may differ about the emergency stop before all are
stopped, s: a stop or its release does not reach all at once."""

DISENGAGED = "let go on request"
"""Reason for free arms after a request to release them."""


@dataclass(frozen=True)
class EngagementParameters(Checked):
    """Conditions for engaging, and for the end."""

    timeout: float = parameter(
        0.1, "time without samples of an arm after which forces go to zero", "s", 0.005, 10.0
    )
    duration: float = parameter(
        0.0, "time from engaging to the end of the graph; 0 for no end", "s", 0.0, 1e6
    )
    listeners: int = parameter(
        1,
        "number of subscribers to each arm's force that engaging waits for: its device, a"
        " recorder",
        low=0,
        high=100,
    )
    compensated: bool = parameter(False, "wait for the compensator's first force before engaging")
    recovery: str = parameter(
        AUTOMATIC,
        "recovery after the peer host was lost: automatic, or only by coupler/engage",
        choices=(AUTOMATIC, MANUAL),
    )


@dataclass(frozen=True)
class Decision:
    """Actions that are due now.

    Attributes
    ----------
    engage, release : bool
        Couple the arms where they are; uncouple them and take their forces off.
    finished : bool
        The duration is over; stays true.
    warning : str
        A line for the log; empty for none.
    """

    engage: bool = False
    release: bool = False
    finished: bool = False
    warning: str = ""


class Engagement:
    """State machine of the coupling: free or engaged.

    The arms engage when their positions are fresh, their devices have said that they are not
    stopped, the compensator has made a force, and every expected subscriber of the arms' forces
    is there. They are released when an arm falls silent, on request, and by the emergency stop,
    and are taken again when the reason has gone, after `FREE_TIME` at the earliest.

    Parameters
    ----------
    parameters : EngagementParameters
    now : float
        Time of the start, s.
    arms : sequence of str
        Arms of this host, of `ARMS`.

    Attributes
    ----------
    engaged : bool
    stop : EmergencyStop
        Stop of the coupler; all are stopped where a device and the coupler differ for too long.
    compensated : bool
        The compensator's force was received, or need not be.
    arms : tuple of str
    """

    def __init__(
        self, parameters: EngagementParameters, now: float, arms: Sequence[str] = ARMS
    ) -> None:
        self._parameters = parameters
        self.arms = tuple(arms)
        self.engaged = False
        self.compensated = not parameters.compensated
        self._received = dict.fromkeys(arms, -math.inf)
        self._freed = ""  # why the arms stay free until they are asked for
        self.stop = EmergencyStop(now)
        self._differing_since = math.inf
        self._arms_stopped: dict[str, bool] = {}
        self._first_engaged = math.inf
        self._released = -math.inf
        self._warned = now
        self._step_due = now

    def position_received(self, arm: str, now: float) -> None:
        """Note a position of an arm."""
        self._received[arm] = now

    def force_received(self) -> None:
        """Note a force of the compensator."""
        self.compensated = True

    def arm_stopped(self, arm: str, stopped: bool) -> None:
        """Note whether the device of an arm follows the emergency stop."""
        self._arms_stopped[arm] = stopped

    def request(self, engage: bool) -> str:
        """Ask for engaging or release; return why that is refused, empty if it is not."""
        if engage and self.stop.stopped:
            return f"{STOPPED}: release it first"
        self._freed = "" if engage else DISENGAGED
        return ""

    def aside(self, now: float) -> bool:
        """Return whether arms that stay free have come to rest, for others to move them."""
        return bool(self._freed) and not self.engaged and now - self._released >= FREE_TIME

    def due(self, now: float) -> bool:
        """Return whether it is time for the next `step`."""
        return now >= self._step_due

    def missing(self, now: float, listeners: int) -> str:
        """Return what engaging waits for, or what has gone; empty when all is there.

        Parameters
        ----------
        now : float
            Time, s.
        listeners : int
            Subscribers of the arm's force that has fewer of them.
        """
        p = self._parameters
        if self._held:
            return self._held
        silent = [arm for arm, then in self._received.items() if now - then > p.timeout]
        if silent:
            return f"waiting for the position of {' and '.join(silent)}"
        if self.engaged:
            return ""
        unknown = [arm for arm in self._received if arm not in self._arms_stopped]
        if unknown:
            return f"waiting for {' and '.join(f'{arm}/stopped' for arm in unknown)}"
        if now - self._released < FREE_TIME:
            return RESTING
        if not self.compensated:
            return "waiting for the compensator's force"
        if listeners < p.listeners:
            return (
                "waiting for subscribers of the arms' forces: there are"
                f" {listeners} of {p.listeners}"
            )
        return ""

    def step(self, now: float, listeners: int) -> Decision:
        """Return what is to be done now; arguments as for `missing`."""
        self._step_due = now + STEP_PERIOD
        differing = self._stop_all(now)
        missing = self.missing(now, listeners)
        engage = not (self.engaged or missing)
        release = self.engaged and bool(missing)
        self.engaged = not missing
        if engage:
            self._first_engaged = min(self._first_engaged, now)
        if release:
            self._released = now
        return Decision(
            engage=engage,
            release=release,
            finished=self._is_over(now),
            warning=differing
            or (f"let go: {missing}" if release else self._due_warning(now, missing)),
        )

    @property
    def _held(self) -> str:
        """Reason for free arms; empty if they may be coupled."""
        if self.stop.stopped or any(self._arms_stopped.values()):
            return STOPPED
        return self._freed

    def _stop_all(self, now: float) -> str:
        """Stop where a device differs for too long; return a line for the log, empty for none."""
        for arm, received in self._received.items():
            if self._parameters.timeout < now - received < math.inf:
                self._arms_stopped.pop(arm, None)  # of a device that has gone
        states = {"coupler": self.stop.stopped, **self._arms_stopped}
        if len(set(states.values())) == 1:
            self._differing_since = math.inf
            return ""
        self._differing_since = min(self._differing_since, now)
        if now - self._differing_since <= DIFFERING:
            return ""
        self._differing_since = math.inf
        self.stop.stop()
        stopped = " and ".join(name for name, state in states.items() if state)
        return f"{STOPPED}: only {stopped} stopped; all are stopped again"

    def _is_over(self, now: float) -> bool:
        return 0 < self._parameters.duration <= now - self._first_engaged

    def _due_warning(self, now: float, missing: str) -> str:
        if not missing or self._held or now - self._warned <= WARNING_PERIOD:
            return ""
        self._warned = now
        return missing
