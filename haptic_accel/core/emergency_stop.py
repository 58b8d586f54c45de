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

"""Emergency stop of a node: a message stops, only a request releases.

The rule has no clock: the caller passes times in s from any origin, which never decrease.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

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
        """Return whether every stop from before the node's start has been received."""
        return now - self._started >= LATCHED_SETTLING

    def stop(self) -> bool:
        """Stop; return whether the state is new."""
        new = not self.stopped
        self.began += new or self._followed
        self.stopped, self._followed = True, False
        return new

    def follow(self) -> None:
        """Stop, without counting: the stop began elsewhere, or before a failed release."""
        self._followed |= not self.stopped
        self.stopped = True

    def receive(self, stop: bool, now: float) -> bool:
        """Handle a stop message; return whether it is new."""
        self._requested = stop
        if stop:
            self._heard = now
        return stop and self.stop()

    def receive_coupler(self, stopped: bool, now: float) -> bool:
        """Handle the state of the graph's coupler; return whether it is a new stop."""
        self._coupler_stopped, self._coupler_heard = stopped, now
        return stopped and self.stop()

    def release(self, now: float, publishers: Sequence[str]) -> str:
        """Release the stop if possible; return the reason against it, or an empty string.

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
