# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The rule by which a node follows the emergency stop: anyone stops, only a request releases.

It has no clock: times are the caller's, in s from any origin and never backwards.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

SETTLING = 1.0
"""Age of a node below which it allows no force and accepts no release, s: messages latched by
several senders come late and in any order, and a stop among them must be heard first."""

RECENT = 0.5
"""Time for which a stop on the topic is a reason to refuse the release, s, whoever said it: as
senders are not told apart, its sender may go on saying so."""

COUPLER_SILENCE = 2.5
"""Silence after which the coupler counts as gone, s: it repeats its state every second."""


class EmergencyStop:
    """Latched emergency stop of one node.

    A word of false on the topic releases nothing. It withdraws the stop that the topic's last
    word of true asked for, after which a release can be requested. What the graph's own coupler
    says stops, too, and must be withdrawn by itself. A stop on another host is followed, but each
    host is released by itself.

    Parameters
    ----------
    now : float
        Time of the node's start, s.

    Attributes
    ----------
    stopped : bool
    began : int
        Number of stops that began on this host.

    Examples
    --------
    >>> stop = EmergencyStop(now=0.0)
    >>> stop.heard(True, now=10.0)
    True
    >>> stop.release(now=11.0, publishers=["/button"])
    '/button said true on the topic, or may have: let it say false, or end it'
    >>> stop.heard(False, now=12.0), stop.stopped
    (False, True)
    >>> stop.release(now=12.0, publishers=["/button"]), stop.stopped
    ('', False)
    """

    def __init__(self, now: float) -> None:
        self.stopped = self._followed = False
        self.began = 0
        self._started = now
        self._wanted = self._coupler_stopped = False
        self._heard = self._coupler_heard = -math.inf

    def is_settled(self, now: float) -> bool:
        """Return whether every stop from before the node's start has been received."""
        return now - self._started >= SETTLING

    def stop(self) -> bool:
        """Stop; return whether that is new."""
        new = not self.stopped
        self.began += new or self._followed
        self.stopped, self._followed = True, False
        return new

    def follow(self) -> None:
        """Stop, but as one that began elsewhere, or before a release that failed."""
        self._followed |= not self.stopped
        self.stopped = True

    def heard(self, stop: bool, now: float) -> bool:
        """Take a word from the topic; return whether it stops what was not stopped."""
        self._wanted = stop
        if stop:
            self._heard = now
        return stop and self.stop()

    def coupler_said(self, stopped: bool, now: float) -> bool:
        """Take the state of the graph's coupler; return as `heard` does."""
        self._coupler_stopped, self._coupler_heard = stopped, now
        return stopped and self.stop()

    def release(self, now: float, publishers: Sequence[str]) -> str:
        """Release the stop, unless there is a reason for it; return that, empty if there is none.

        Parameters
        ----------
        now : float
            Time, s.
        publishers : sequence of str
            Nodes that publish the topic now.
        """
        refusal = self._refusal(now, publishers)
        self.stopped = self.stopped and bool(refusal)
        return refusal

    def _refusal(self, now: float, publishers: Sequence[str]) -> str:
        if not self.is_settled(now):
            return "has just started: ask again in a second"
        if self._wanted and publishers:
            names = " and ".join(publishers)
            return f"{names} said true on the topic, or may have: let it say false, or end it"
        if now - self._heard < RECENT:
            return "somebody has just said true on the topic: ask again in a second"
        if self._coupler_stopped and now - self._coupler_heard < COUPLER_SILENCE:
            return "the coupler is stopped: release it by its service estop"
        return ""
