# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Engagement of the two arms: conditions for coupling, release, re-engagement and the end.

The state machine has no clock: the caller passes times in s, which never decrease.

A message triggers the emergency stop; only a request releases it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from haptic_accel.core.actuator import AUTOMATIC, MANUAL
from haptic_accel.core.parameters import Checked, parameter
from haptic_accel.core.tick.coupling import STEP_PERIOD, ArmWatch
from haptic_accel.core.topics import ARMS

LATCHED_SETTLING = 1.0
"""Minimum age of a node for forces and for a release, s. Latched messages of several senders
arrive late and in any order, and a stop among them must be received first."""

RECENT = 0.5
"""Time for which a stop on the topic prevents the release, s. As senders cannot be distinguished,
its sender may still be repeating it."""

COUPLER_SILENCE = 2.5
"""Time without messages after which the coupler counts as ended, s; it repeats its state every
second."""


class EmergencyStop:
    """Latched emergency stop of one node.

    Publishing false does not release the stop, but withdraws the last true on the topic, so that a
    release can be requested. A stop reported by the graph's coupler also stops the node, and only
    the coupler can withdraw it. A stop on another host also stops this node, but each host is
    released separately.

    Parameters
    ----------
    now : float
        Start time of the node, s.

    Attributes
    ----------
    stopped : bool
    began : int
        Number of stops that began on this host.

    Examples
    --------
    >>> stop = EmergencyStop(now=0.0)
    >>> stop.receive(True, now=10.0)
    True
    >>> stop.release(now=11.0, publishers=["/button"])
    '/button published true on the topic, or may have: let it publish false, or end it'
    >>> stop.receive(False, now=12.0), stop.stopped
    (False, True)
    >>> stop.release(now=12.0, publishers=["/button"]), stop.stopped
    ('', False)
    """

    def __init__(self, now: float) -> None:
        self.stopped = self._followed = False
        self.began = 0
        self._started = now
        self._requested = self._coupler_stopped = False
        self._heard = self._coupler_heard = -math.inf

    def is_settled(self, now: float) -> bool:
        """Return True if every stop from before the node's start has been received."""
        return now - self._started >= LATCHED_SETTLING

    def stop(self) -> bool:
        """Stop; return True if the state is new."""
        new = not self.stopped
        self.began += new or self._followed
        self.stopped, self._followed = True, False
        return new

    def follow(self) -> None:
        """Stop, without counting: the stop began elsewhere, or before a failed release."""
        self._followed |= not self.stopped
        self.stopped = True

    def receive(self, stop: bool, now: float) -> bool:
        """Handle a stop message; return True if it is a new stop."""
        self._requested = stop
        if stop:
            self._heard = now
        return stop and self.stop()

    def receive_coupler(self, stopped: bool, now: float) -> bool:
        """Handle the state of the graph's coupler; return True if it is a new stop."""
        self._coupler_stopped, self._coupler_heard = stopped, now
        return stopped and self.stop()

    def release(self, now: float, publishers: Sequence[str]) -> str:
        """Release the stop if possible; return the reason for a refusal, or an empty string.

        Parameters
        ----------
        now : float
            Time, s.
        publishers : sequence of str
            Nodes that publish the topic at present.
        """
        refusal = self._refusal(now, publishers)
        self.stopped = self.stopped and bool(refusal)
        return refusal

    def _refusal(self, now: float, publishers: Sequence[str]) -> str:
        if not self.is_settled(now):
            return "has just started: ask again in a second"
        if self._requested and publishers:
            names = " and ".join(publishers)
            return (
                f"{names} published true on the topic, or may have: let it publish false,"
                " or end it"
            )
        if now - self._heard < RECENT:
            return "true was just published on the topic: ask again in a second"
        if self._coupler_stopped and now - self._coupler_heard < COUPLER_SILENCE:
            return "the coupler is stopped: release it by its service estop"
        return ""


WARNING_PERIOD = 5.0
"""Interval between "waiting for ..." warnings, s."""

FREE_TIME = 0.5
"""Minimum time between release and re-engagement, s. The positions at engagement become the
reference positions, so the arms must be at rest. The arms of the virtual rig are back at their
start by then."""

RESTING = "waiting for the arms to come to rest"
"""Reason for free arms shortly after their release."""

STOPPED = "emergency stop"
"""Reason for free arms while the emergency stop is not released."""

DIFFERING = 0.5
"""Maximum time for which a device and the coupler may disagree about the emergency stop, s;
afterwards all nodes stop. A stop or its release does not reach all nodes at the same time."""

DISENGAGED = "free on request"
"""Reason for free arms after a request to release them."""


@dataclass(frozen=True)
class EngagementParameters(Checked):
    """Conditions for engagement and its end."""

    timeout: float = parameter(
        0.1, "time without samples of an arm after which forces are set to zero", "s", 0.005, 10.0
    )
    duration: float = parameter(
        0.0, "time from engaging to the end of the graph; 0 for no end", "s", 0.0, 1e6
    )
    listeners: int = parameter(
        1, "subscribers to each arm's force needed to engage (device, recorder)", low=0, high=100
    )
    compensated: bool = parameter(False, "wait for the compensator's first force before engaging")
    recovery: str = parameter(
        AUTOMATIC,
        "recovery after the peer host was lost: automatic, or only by coupler/engage",
        choices=(AUTOMATIC, MANUAL),
    )


@dataclass(frozen=True)
class Decision:
    """Actions that are due in a step.

    Attributes
    ----------
    engage, release : bool
        Couple the arms at their positions; uncouple them and set their forces to zero.
    resume : bool
        Couple them at their previous reference positions.
    finished : bool
        True once the duration is over.
    warning : str
        Line for the log; may be empty.
    """

    engage: bool = False
    release: bool = False
    resume: bool = False
    finished: bool = False
    warning: str = ""


class Engagement:
    """State machine of the coupling, with the states free and engaged.

    The arms engage when their positions are recent, their devices report no stop, the compensator
    has sent a force, and all expected subscribers to the arms' forces exist. They are released
    when an arm sends no more samples, on request, and by the emergency stop. They engage again
    when the reason is gone, but not before `FREE_TIME`.

    Parameters
    ----------
    parameters : EngagementParameters
    now : float
        Start time, s.
    arms : sequence of str
        Arms of this host, from `ARMS`.

    Attributes
    ----------
    engaged : bool
    stop : EmergencyStop
        Stop of the coupler; a long disagreement with a device stops all nodes.
    compensated : bool
        True if a force of the compensator was received, or none is required.
    watches : dict of ArmWatch
        Monitors of the arms' positions; the caller passes each position to its arm's monitor.
    arms : tuple of str
    """

    def __init__(
        self, parameters: EngagementParameters, now: float, arms: Sequence[str] = ARMS
    ) -> None:
        self._parameters = parameters
        self.arms = tuple(arms)
        self.engaged = False
        self.compensated = not parameters.compensated
        self.watches = {arm: ArmWatch(arm, parameters.timeout) for arm in arms}
        self._freed = ""  # why the arms remain free until a request
        self.stop = EmergencyStop(now)
        self._differing_since = math.inf
        self._arms_stopped: dict[str, bool] = {}
        self._first_engaged = math.inf
        self._released = -math.inf
        self._warned = now
        self._step_due = now

    @property
    def refused(self) -> int:
        """Number of positions that are not finite, or farther than an arm can have moved."""
        return sum(watch.refused for watch in self.watches.values())

    @property
    def interrupted(self) -> str:
        """Interruption or jump that ends the engagement at the next `decide`; empty if none."""
        found = [w.interrupted for w in self.watches.values() if w.interrupted]
        return found[-1] if found else ""

    def arm_stopped(self, arm: str, stopped: bool) -> None:
        """Record whether the device of an arm is stopped."""
        self._arms_stopped[arm] = stopped

    def request(self, engage: bool) -> str:
        """Request engagement or release; return the reason for a refusal, or an empty string."""
        if engage and self.stop.stopped:
            return f"{STOPPED}: release it first"
        self._freed = "" if engage else DISENGAGED
        return ""

    def aside(self, now: float) -> bool:
        """Return True if free arms are at rest, so that others may move them."""
        return bool(self._freed) and not self.engaged and now - self._released >= FREE_TIME

    def due(self, now: float) -> bool:
        """Return True if the next `decide` is due."""
        return now >= self._step_due or bool(self.interrupted)

    def missing(self, now: float, listeners: int) -> str:
        """Return the reason that prevents engagement, or ends it; empty if there is none.

        Parameters
        ----------
        now : float
            Time, s.
        listeners : int
            Number of subscribers to an arm's force; the smaller one of both arms.
        """
        p = self._parameters
        if self._held:
            return self._held
        silent = [each for each in self.watches.values() if now - each.received > p.timeout]
        if silent:
            refusals = "".join(each.refusal for each in silent)
            names = " and ".join(each.arm for each in silent)
            return f"waiting for the position of {names}{refusals}"
        if self.engaged:
            return self.interrupted
        unknown = [arm for arm in self.arms if arm not in self._arms_stopped]
        if unknown:
            return f"waiting for {' and '.join(f'{arm}/stopped' for arm in unknown)}"
        if now - self._released < FREE_TIME:
            return RESTING
        if not self.compensated:
            return "waiting for the compensator's force"
        if listeners < p.listeners:
            return f"waiting for subscribers of arm forces: there are {listeners} of {p.listeners}"
        return ""

    def decide(self, now: float, listeners: int) -> Decision:
        """Return the actions that are due; see `missing` for the arguments."""
        self._step_due = now + STEP_PERIOD
        differing = self._stop_all(now)
        missing = self.missing(now, listeners)
        engage = not (self.engaged or missing)
        release = self.engaged and bool(missing)
        self.engaged = not missing
        if engage:
            self._first_engaged = min(self._first_engaged, now)
        for watch in self.watches.values():
            watch.interrupted = ""
        if release:
            self._released = now
        return Decision(
            engage=engage,
            release=release,
            finished=0 < self._parameters.duration <= now - self._first_engaged,
            warning=differing
            or (f"uncoupled: {missing}" if release else self._due_warning(now, missing)),
        )

    @property
    def _held(self) -> str:
        """Reason why the arms must remain free; empty if they may be coupled."""
        if self.stop.stopped or any(self._arms_stopped.values()):
            return STOPPED
        return self._freed

    def _stop_all(self, now: float) -> str:
        """Stop all after a long disagreement with a device; return a log line, or ""."""
        for arm, watch in self.watches.items():
            if self._parameters.timeout < now - watch.received < math.inf:
                self._arms_stopped.pop(arm, None)  # the device no longer exists
        states = {"coupler": self.stop.stopped, **self._arms_stopped}
        differ = len(set(states.values())) > 1
        self._differing_since = min(self._differing_since, now) if differ else math.inf
        if now - self._differing_since <= DIFFERING:
            return ""
        self._differing_since = math.inf
        self.stop.stop()
        stopped = " and ".join(name for name, state in states.items() if state)
        return f"{STOPPED}: only {stopped} stopped; all are stopped again"

    def _due_warning(self, now: float, missing: str) -> str:
        if not missing or self._held or now - self._warned <= WARNING_PERIOD:
            return ""
        self._warned = now
        return missing
