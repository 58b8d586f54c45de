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

"""Executable `link`: carries datagrams between the half couplers of two hosts, and nothing else.

The link is no ROS node, since topics stay on their machine. It does not read the datagrams.
"""

from __future__ import annotations

import gc
import logging
import select
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, Protocol

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.stop_signal import own_domain
from haptic_accel.kits.link.authentication import Authenticator, read_key
from haptic_accel.kits.link.local import LINK, LocalEnd
from haptic_accel.kits.link.peer_monitor import PeerMonitor, advice, described
from haptic_accel.kits.link.udp import UdpCarrier
from haptic_accel.kits.link.zenoh import ZenohCarrier
from haptic_accel.links.addresses import Route, bound, route
from haptic_accel.links.parameters import UDP, LinkNodeParameters, check_peer
from haptic_accel.nodes.priority import ask_for_realtime
from haptic_accel.nodes.scheduling import LOOK_ROUND, TEARDOWN, Signals, run_process
from haptic_accel.setup.arguments import LOG_LEVELS
from haptic_accel.setup.files import read_parameter_file
from haptic_accel.setup.node_parameters import node_parameters

SEARCH_PERIOD = 2.0
"""Interval between attempts to find the way to a peer, s."""

NOTE_PERIOD = 1.0
"""Interval between lines to the coupler about this link, s, as it may have started again."""

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
    """Carry datagrams both ways until the process has to end.

    A separate thread carries the peer's datagrams, so that each direction sleeps until a datagram
    comes. The coupler gets a line on a fault, or the note if there is none.

    Raises
    ------
    Exception
        Error that ended that thread.
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
        if select.select([local], [], [], LOOK_ROUND)[0]:
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
    logging.raiseExceptions = False  # there may be no reader
    key = read_key(parameters.keys) if parameters.keys and parameters.transport == UDP else b""
    way = _way(parameters, namespace, signals)
    if way is None:
        return
    # This machine's name might resolve elsewhere.
    check_peer(way.peer, parameters.transport, parameters.keys, insecure=parameters.insecure)
    hints = advice(way, parameters.side, parameters.transport)
    monitor = PeerMonitor(f"peer {way.host}", hints, parameters.keys, time.monotonic())
    note = INSECURE if parameters.insecure else ""
    with closing(LocalEnd(LINK, own_domain(), namespace)) as local:
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


def _way(parameters: LinkNodeParameters, namespace: str, signals: Signals) -> Route | None:
    """Return the transport to the peer once available; None if the process has to end before.

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
            time.sleep(LOOK_ROUND)
    return None


def _given(words: Sequence[str]) -> tuple[str, str, LinkNodeParameters]:
    """Return namespace, log level and parameters from a command line as `graph` writes it.

    Raises
    ------
    ParameterError
        A word or value is not allowed, a file cannot be read, or no peer is given.
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
        values |= read_parameter_file(file, namespace)["link"]
    parameters, _ = node_parameters("link", values)
    if not parameters.peer:
        raise ParameterError("peer = '': must be HOST or HOST:PORT of the other host")
    return namespace, level, parameters


if __name__ == "__main__":
    main()
