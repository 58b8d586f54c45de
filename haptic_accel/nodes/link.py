# SPDX-FileCopyrightText: 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Executable `link`: carries datagrams between the half couplers of two hosts, and nothing else.

It is no node of the graph, whose topics stay on their machine. What it carries it does not read.
"""

from __future__ import annotations

import gc
import os
import select
import struct
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import cycle, pairwise
from pathlib import Path
from typing import Any, Protocol

import rclpy
from rclpy.logging import get_logger
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import UInt8MultiArray

from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.claims import own_domain
from haptic_accel.graph.files import read_parameter_file
from haptic_accel.graph.node_parameters import node_parameters
from haptic_accel.links.addresses import Route, check_free, check_opened, route
from haptic_accel.links.fastdds import profile
from haptic_accel.links.hearing import Hearing, advice, described
from haptic_accel.links.local import LINK, LONGEST, LocalEnd
from haptic_accel.links.parameters import LinkNodeParameters
from haptic_accel.links.zenoh import ZenohCarrier
from haptic_accel.nodes.middleware import DISCOVERY_RANGE, PROFILES_FILES, STATIC_PEERS
from haptic_accel.nodes.scheduling import (
    LOOK_ROUND,
    TEARDOWN,
    EventsExecutor,
    Signals,
    SupervisedNode,
    ask_for_realtime,
    close_nodes,
    run_process,
    take_arguments,
)

DOMAIN = 100
"""ROS domain of all links: the local graphs need not agree on theirs, and ports are explicit."""

WAITING = 64
"""Datagrams kept for a thread that is late, of which the newest count: 0.1 s."""

PUBLISHERS = 32
"""Publishers that take turns: a subscriber at best effort drops what a later message of the same
publisher has overtaken. With as many, a packet each ms may come up to 31 ms late."""

MIDDLEWARE = "rmw_fastrtps"
"""Start of the names of the middleware that follows the profile."""

SEARCH_PERIOD = 2.0
"""Interval between attempts to find the way to a peer, s."""

_HEAD = struct.Struct("<4sIII")
_ENCAPSULATION = b"\0\1\0\0"  # plain little-endian CDR; then no dimensions, no offset, length


class Carrier(Protocol):
    """Way of datagrams to and from the peer host."""

    def send(self, datagram: bytes) -> None:
        """Send a datagram, or drop it."""

    def run(self, deliver: Callable[[bytes], object]) -> None:
        """Pass received datagrams on until `close` is called from another thread."""

    def close(self) -> None:
        """Release everything."""


class DdsCarrier:
    """Carries datagrams by one topic in each direction, best effort, of one participant.

    Parameters
    ----------
    route : Route
    side : str
        Side of this host, from `ARMS`.

    Raises
    ------
    ParameterError
        The middleware is another, or the port is taken: Fast DDS would take the next but one.
    ConnectionError
        The port was not opened.
    """

    def __init__(self, route: Route, side: str) -> None:
        used = rclpy.get_rmw_implementation_identifier()
        if not used.startswith(MIDDLEWARE):
            raise ParameterError(
                f"RMW_IMPLEMENTATION = {used}: must be {MIDDLEWARE}_cpp for transport dds; or use"
                " transport:=zenoh"
            )
        check_free(route.own, route.own_port)
        self._over = threading.Event()
        self._deliver: Callable[[bytes], object] = lambda datagram: None
        self.node = _bare_node()
        # Fast DDS goes on without an interface that was not up.
        check_opened(route.own, route.own_port)
        quality = QoSProfile(depth=WAITING, reliability=ReliabilityPolicy.BEST_EFFORT)
        topics = {name: f"link/from_{name}" for name in ("master", "slave")}
        own = topics.pop(side)
        publishers = [
            self.node.create_publisher(UInt8MultiArray, own, quality) for _ in range(PUBLISHERS)
        ]
        self._turns: Iterator[Any] = cycle([each.handle.publish_raw for each in publishers])
        (heard,) = topics.values()
        self.node.create_subscription(UInt8MultiArray, heard, self._take, quality, raw=True)

    def send(self, datagram: bytes) -> None:
        """Send a datagram to whom discovery has found."""
        next(self._turns)(_HEAD.pack(_ENCAPSULATION, 0, 0, len(datagram)) + datagram)

    def run(self, deliver: Callable[[bytes], object]) -> None:
        """Pass received datagrams on until `close` is called."""
        self._deliver = deliver
        executor = EventsExecutor()
        executor.add_node(self.node)
        try:
            while not self._over.is_set():
                executor.spin_once(timeout_sec=LOOK_ROUND)
        finally:
            executor.shutdown()

    def close(self) -> None:
        """End receiving."""
        self._over.set()

    def _take(self, message: bytes) -> None:
        if len(message) < _HEAD.size:
            return
        head, datagram = message[: _HEAD.size], message[_HEAD.size :]
        *start, length = _HEAD.unpack(head)
        if start == [_ENCAPSULATION, 0, 0] and length <= min(len(datagram), LONGEST):
            self._deliver(datagram[:length])


@contextmanager
def only_for(route: Route) -> Iterator[None]:
    """Let participants made within be of one route's profile.

    To be entered before ROS is initialised, which reads where nodes are to be looked for.
    """
    for name in (STATIC_PEERS, "ROS_LOCALHOST_ONLY"):
        os.environ.pop(name, None)
    os.environ[DISCOVERY_RANGE] = "SYSTEM_DEFAULT"  # leaves it to the profile
    with tempfile.NamedTemporaryFile("w", suffix=".xml") as file:
        file.write(profile(route))
        file.flush()
        os.environ.update(dict.fromkeys(PROFILES_FILES, file.name))
        yield


def _bare_node() -> SupervisedNode:
    """Return a node without the topics and services of any."""
    node = SupervisedNode(
        "link",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )
    for publisher in list(node.publishers):
        node.destroy_publisher(publisher)
    return node


def carry(local: LocalEnd, carrier: Carrier, hearing: Hearing, signals: Signals) -> None:
    """Carry datagrams both ways until the process has to end.

    Those from the peer are carried by a thread of its own, so that each direction sleeps until
    something comes.

    Raises
    ------
    Exception
        Error that ended that thread.
    """
    logger = get_logger("link")
    failures: list[Exception] = []

    def deliver(datagram: bytes) -> None:
        hearing.heard += 1
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
    while not (signals.ended() or failures):
        if select.select([local], [], [], LOOK_ROUND)[0]:
            for datagram in local.take():
                carrier.send(datagram)
        if line := hearing.line(time.monotonic()):
            logger.info(line)
    carrier.close()
    receiver.join(TEARDOWN)
    if failures:
        raise failures[0]


def main() -> None:
    """Run the link until a signal, or the end of its parent."""
    run_process("link", _run)


def _run(signals: Signals) -> None:
    namespace, parameters = _given(sys.argv[1:])
    way = _way(parameters, namespace, signals)
    if way is None:
        return
    well = False
    nodes: list[SupervisedNode] = []
    try:
        with closing(LocalEnd(LINK, own_domain(), namespace)) as local:
            logger = get_logger("link")
            with only_for(way):
                take_arguments(DOMAIN)
                if parameters.transport == "dds":
                    carrier: Carrier = (dds := DdsCarrier(way, parameters.side))
                    nodes.append(dds.node)
            if parameters.transport == "zenoh":
                if parameters.side == "slave":
                    check_free(way.own, way.own_port)
                say = logger.warning
                carrier = ZenohCarrier(way, parameters.side, namespace, parameters.keys, say)
            logger.info(described(way, parameters.side, parameters.transport))
            hints = advice(way, parameters.side, parameters.transport)
            hearing = Hearing(f"peer {way.host}", hints, time.monotonic())
            carry(local, carrier, hearing, signals)
        well = True
    finally:
        close_nodes(nodes, well)


def _way(parameters: LinkNodeParameters, namespace: str, signals: Signals) -> Route | None:
    """Return the way to the peer as soon as there is one; None if the process has to end before.

    A robot may be switched on before its network is.
    """
    said = ""
    while not signals.ended():
        try:
            return route(parameters.peer, parameters.side, parameters.transport, namespace)
        except ConnectionError as error:
            if said != (said := str(error)):
                get_logger("link").warning(f"{said}; trying again")
        due = time.monotonic() + SEARCH_PERIOD
        while time.monotonic() < due and not signals.ended():
            time.sleep(LOOK_ROUND)
    return None


def _given(words: Sequence[str]) -> tuple[str, LinkNodeParameters]:
    """Return namespace and parameters from a command line as `graph` writes it.

    Raises
    ------
    ParameterError
        A file cannot be read, a value is not allowed, or no peer is given.
    """
    namespace, values = "", dict[str, Any]()
    for word, following in pairwise(words):
        if word in ("-r", "--remap") and following.startswith("__ns:="):
            namespace = following.partition(":=")[2].rstrip("/")
    for word, following in pairwise(words):
        if word == "--params-file":
            values |= read_parameter_file(Path(following), namespace)["link"]
    parameters, _ = node_parameters("link", values)
    if not parameters.peer:
        raise ParameterError("peer = '': must be HOST or HOST:PORT of the other host")
    return namespace, parameters


if __name__ == "__main__":
    main()
