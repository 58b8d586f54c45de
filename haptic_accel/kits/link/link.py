# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `link`: carries datagrams between the half couplers of two hosts, and nothing else.

The link is no ROS node, since topics stay on their machine. It does not read the datagrams.
"""

from __future__ import annotations

import gc
import logging
import select
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, Protocol

from haptic_accel import ParameterError, setup
from haptic_accel.core import UDP
from haptic_accel.graph import own_domain
from haptic_accel.kits.link import datagrams
from haptic_accel.kits.link.addresses import Route, bound, route
from haptic_accel.kits.link.datagrams import Authenticator, LocalEnd, read_key
from haptic_accel.kits.link.zenoh import ZenohCarrier
from haptic_accel.nodes import POLL_PERIOD, TEARDOWN, Signals, run_process
from haptic_accel.nodes.timing import ask_for_realtime
from haptic_accel.setup.arguments import LOG_LEVELS

END_CHECK_PERIOD = 0.25
"""Interval of checks for the end while nothing is received, s."""

BURST, BURST_TIME, BREAK = 500, 0.1, 1e-3
"""Number of datagrams within a time, s, that exceeds any traffic between two hosts, and the pause
after it, s, so that a flooded port does not use up the processor."""


class UdpCarrier:
    """Transport of datagrams on one UDP port of this host; unknown senders get no answer.

    Parameters
    ----------
    route : Route
    authenticator : Authenticator
    refused : callable
        Called with the sender's address of a datagram with an invalid tag.

    Raises
    ------
    ParameterError
        The port is in use.
    """

    def __init__(
        self, route: Route, authenticator: Authenticator, refused: Callable[[str], None]
    ) -> None:
        self._authenticator, self._refused = authenticator, refused
        self._socket = bound(route.own, route.own_port)
        # Use a time-out: closing a socket does not wake threads that wait for it.
        pause = struct.pack("ll", 0, round(END_CHECK_PERIOD * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, pause)
        family = self._socket.family
        found = socket.getaddrinfo(route.peer, route.peer_port, family, socket.SOCK_DGRAM)
        self._peer = found[0][4]
        self._over = threading.Event()

    def send(self, datagram: bytes) -> None:
        """Send a datagram; discard it without a route or room."""
        with suppress(OSError):
            self._socket.sendto(
                self._authenticator.tagged(datagram), socket.MSG_DONTWAIT, self._peer
            )

    def run(self, deliver: Callable[[bytes], object]) -> None:
        """Pass the peer's datagrams on until `close` is called."""
        receive, verified = self._socket.recvfrom, self._authenticator.verified
        count, since = 0, time.monotonic()
        while not self._over.is_set():
            try:
                data, sender = receive(datagrams.LONGEST_DATAGRAM + datagrams.TAG_LENGTH + 1)
            except BlockingIOError:
                continue
            datagram = verified(data)
            if datagram is None:
                self._refused(sender[0])
            elif len(datagram) <= datagrams.LONGEST_DATAGRAM:
                deliver(datagram)
            count += 1
            if count % BURST == 0:
                if time.monotonic() - since < BURST_TIME:
                    time.sleep(BREAK)
                since = time.monotonic()
        self._socket.close()

    def close(self) -> None:
        """End receiving."""
        self._over.set()


SILENCE = 5.0
"""Time without datagrams that causes a log line, s."""

REPEAT = 60.0
"""Minimum interval between log lines on unknown senders, s, so that they do not fill the log."""


class PeerMonitor:
    """Monitor that reports reception and loss of datagrams, with a log line for each change.

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


SEARCH_PERIOD = 2.0
"""Interval between attempts to find the route to a peer, s."""

NOTE_PERIOD = 1.0
"""Interval between status lines to the coupler, s, which may have been restarted."""

INSECURE = (
    "insecure:=true: datagrams are not authenticated: whoever reaches the port can move the arm;"
    " make keys with haptic-accel keys"
)

_FORMAT = "[%(levelname)s] [%(created).9f] [link]: %(message)s"
"""Form of a line of a node's log."""

_logger = logging.getLogger("link")


class Carrier(Protocol):
    """Transport of datagrams between the hosts."""

    def send(self, datagram: bytes) -> None:
        """Send a datagram, or drop it."""

    def run(self, deliver: Callable[[bytes], object]) -> None:
        """Pass received datagrams on until `close` is called from another thread."""

    def close(self) -> None:
        """Release everything."""


def carry(
    local: LocalEnd, carrier: Carrier, monitor: PeerMonitor, signals: Signals, note: str = ""
) -> None:
    """Carry datagrams in both directions until the process must end.

    A separate thread carries the peer's datagrams, so that each direction sleeps until a datagram
    comes. The coupler receives a line on a fault or, without a fault, the note.

    Raises
    ------
    Exception
        Any error that has ended the separate thread.
    """
    failures: list[Exception] = []

    def deliver(datagram: bytes) -> None:
        monitor.received += 1
        local.send(datagram)

    def receive() -> None:
        try:
            carrier.run(deliver)
        except Exception as error:
            failures.append(error)

    receiver = threading.Thread(target=receive, daemon=True)
    receiver.start()
    ask_for_realtime()
    gc.collect()
    gc.freeze()
    gc.disable()
    noted = 0.0
    while not (signals.ended() or failures):
        if select.select([local], [], [], POLL_PERIOD)[0]:
            for datagram in local.drain():
                carrier.send(datagram)
        for line in monitor.lines(now := time.monotonic()):
            _logger.log(logging.WARNING if line == monitor.problem else logging.INFO, line)
        if now - noted >= NOTE_PERIOD:
            noted = now
            local.write_note(monitor.problem or note)
    carrier.close()
    receiver.join(TEARDOWN)
    if failures:
        raise failures[0]


def main() -> None:
    """Run the link until a signal, or the end of its parent."""
    run_process("link", _run)


def _run(signals: Signals) -> None:
    namespace, level, parameters = _given(sys.argv[1:])
    logging.addLevelName(logging.WARNING, "WARN")
    logging.basicConfig(format=_FORMAT, level=level.upper())
    logging.raiseExceptions = False  # the log may have no reader
    key = read_key(parameters.keys) if parameters.keys and parameters.transport == UDP else b""
    way = _way(parameters, namespace, signals)
    if way is None:
        return
    # Check the resolved address: this machine's name might resolve to another host.
    setup.check_peer(way.peer, parameters.transport, parameters.keys, insecure=parameters.insecure)
    hints = advice(way, parameters.side, parameters.transport)
    monitor = PeerMonitor(f"peer {way.host}", hints, parameters.keys, time.monotonic())
    note = INSECURE if parameters.insecure else ""
    with closing(LocalEnd(datagrams.LINK, own_domain(), namespace)) as local:
        if parameters.transport == UDP:
            authenticator = Authenticator(key, parameters.side, namespace)
            carrier: Carrier = UdpCarrier(way, authenticator, monitor.refuse)
        else:
            if parameters.side == "slave":
                bound(way.own, way.own_port).close()
            say = _logger.warning
            carrier = ZenohCarrier(way, parameters.side, namespace, parameters.keys, say)
        _logger.info(described(way, parameters.side, parameters.transport))
        if note:
            _logger.warning(note)
        carry(local, carrier, monitor, signals, note)


def _way(parameters: setup.LinkNodeParameters, namespace: str, signals: Signals) -> Route | None:
    """Return the route to the peer once available; None if the process must end before.

    A robot may start before its network.
    """
    said = ""
    while not signals.ended():
        try:
            return route(parameters.peer, parameters.side, parameters.transport, namespace)
        except ConnectionError as error:
            if said != (said := str(error)):
                _logger.warning(f"{said}; trying again")
        due = time.monotonic() + SEARCH_PERIOD
        while time.monotonic() < due and not signals.ended():
            time.sleep(POLL_PERIOD)
    return None


def _given(words: Sequence[str]) -> tuple[str, str, setup.LinkNodeParameters]:
    """Return namespace, log level and parameters from a command line as `graph` writes it.

    Raises
    ------
    ParameterError
        An argument is not allowed, a file cannot be read, or no peer is specified.
    """
    given = [word for word in words if word != "--ros-args"]
    namespace, level, files = "", "info", list[Path]()
    for word, following in zip(given[::2], given[1::2], strict=False):
        if word == "--params-file":
            files.append(Path(following))
        elif word == "--log-level" and following in LOG_LEVELS:
            level = following
        elif word in ("-r", "--remap") and following.startswith("__ns:="):
            namespace = following.partition(":=")[2].rstrip("/")
        else:
            raise ParameterError(f"{word} {following}: no such argument")
    values = dict[str, Any]()
    for file in files:
        values |= setup.read_parameter_file(file, namespace)["link"]
    parameters, _ = setup.build_parameters("link", values)
    if not parameters.peer:
        raise ParameterError("peer = '': must be HOST or HOST:PORT of the other host")
    return namespace, level, parameters


if __name__ == "__main__":
    main()
