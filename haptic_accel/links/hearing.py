# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Messages about the peer: heard, no longer heard, and the points to check then."""

from __future__ import annotations

from haptic_accel.links.addresses import Route

SILENCE = 5.0
"""Time without a datagram after which there is a line about it, and between lines, s."""


class Hearing:
    """Turns datagrams and silence into lines for the log, one at each change.

    Parameters
    ----------
    peer : str
        Peer in the lines.
    advice : str
        Points to check while nothing is heard.
    now : float
        Steady time, s.

    Attributes
    ----------
    heard : int
        Datagrams received.
    """

    def __init__(self, peer: str, advice: str, now: float) -> None:
        self.heard = 0
        self._peer, self._advice = peer, advice
        self._known, self._last, self._hears, self._silent = 0, now, False, False

    def line(self, now: float) -> str:
        """Return a line if there is something new; empty otherwise. To be called often."""
        if self.heard != self._known:
            self._known, self._last = self.heard, now
            new, self._hears, self._silent = not self._hears, True, False
            return f"{self._peer} is heard" if new else ""
        if now - self._last < SILENCE or self._silent:
            return ""
        self._hears, self._silent = False, True
        return f"{self._peer}: nothing heard for {SILENCE:g} s; {self._advice}"


def described(route: Route, side: str, transport: str) -> str:
    """Return who sends where: addresses and ports of UDP."""
    if transport == "dds":
        return (
            f"{side} at {route.own}, hears on port {route.own_port}/udp, sends to {route.peer}"
            f" port {route.peer_port}/udp (dds)"
        )
    if side == "slave":
        return f"slave at {route.own}, the peer connects to port {route.own_port}/udp (zenoh)"
    return f"master at {route.own}, connects to {route.peer} port {route.peer_port}/udp (zenoh)"


def advice(route: Route, side: str, transport: str) -> str:
    """Return what to check while the peer is not heard."""
    other = "slave" if side == "master" else "master"
    return (
        f"{described(route, side, transport)}: check that the firewalls of both hosts let this"
        f" pass, and that the peer runs with side:={other} transport:={transport}, the same"
        " namespace and version"
    )
