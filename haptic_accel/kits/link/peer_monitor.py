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

"""Log lines on a peer's reception and loss, with hints for a loss."""

from __future__ import annotations

from haptic_accel.links.addresses import Route
from haptic_accel.links.parameters import UDP

SILENCE = 5.0
"""Time without datagrams that causes a log line, s."""

REPEAT = 60.0
"""Minimum interval between log lines on unknown senders, s, so that they do not fill the log."""


class PeerMonitor:
    """Convert reception and loss of datagrams to log lines, one for each change.

    Parameters
    ----------
    peer : str
        Name of the peer in the lines.
    advice : str
        Advice while nothing is received.
    keys : str
        Folder of this host's keys; empty for none.
    now : float
        Monotonic time, s.

    Attributes
    ----------
    received : int
        Number of datagrams from the peer.
    problem : str
        Reason why datagrams are rejected, one line; empty if none are.
    """

    def __init__(self, peer: str, advice: str, keys: str, now: float) -> None:
        self.received = 0
        self.problem = ""
        self._peer, self._advice = peer, advice
        self._keys = f"here keys:={keys}" if keys else "this host has none"
        self._known, self._last, self._hears, self._silent = 0, now, False, False
        self._strangers, self._stranger = 0, ""
        self._refused, self._refused_at, self._said = 0, -SILENCE, -REPEAT

    def refuse(self, address: str) -> None:
        """Count a datagram without the link's key from an address."""
        self._strangers += 1
        self._stranger = address

    def lines(self, now: float) -> list[str]:
        """Return new log lines; call it often."""
        return [line for line in (self._of_strangers(now), self._of_peer(now)) if line]

    def _of_strangers(self, now: float) -> str:
        if self._strangers != self._refused:
            self._refused, self._refused_at = self._strangers, now
            self.problem = (
                f"datagrams from {self._stranger} do not have this link's key: both hosts need"
                f" folders of one haptic-accel keys, {self._keys}; {self._refused} refused"
            )
        elif now - self._refused_at > SILENCE:
            self.problem = ""
        if not self.problem or now - self._said < REPEAT:
            return ""
        self._said = now
        return self.problem

    def _of_peer(self, now: float) -> str:
        if self.received != self._known:
            self._known, self._last = self.received, now
            new, self._hears, self._silent = not self._hears, True, False
            return f"{self._peer} is heard" if new else ""
        if now - self._last < SILENCE or self._silent:
            return ""
        self._hears, self._silent = False, True
        return f"{self._peer}: nothing received for {SILENCE:g} s; {self._advice}"


def described(route: Route, side: str, transport: str) -> str:
    """Return a description of the route: addresses and UDP ports."""
    if transport == UDP:
        return (
            f"{side} at {route.own}, receives on port {route.own_port}/udp, sends to {route.peer}"
            f" port {route.peer_port}/udp"
        )
    if side == "slave":
        return f"slave at {route.own}, the peer connects to port {route.own_port}/udp (zenoh)"
    return f"master at {route.own}, connects to {route.peer} port {route.peer_port}/udp (zenoh)"


def advice(route: Route, side: str, transport: str) -> str:
    """Return hints on a peer from which nothing is received."""
    other = "slave" if side == "master" else "master"
    return (
        f"{described(route, side, transport)}: check that the firewalls of both hosts let this"
        f" pass, and that the peer runs with side:={other} transport:={transport} and the same"
        " namespace"
    )
