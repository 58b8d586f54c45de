# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both sides of a graph on this machine, with a simulated network between the arms."""

from __future__ import annotations

import queue
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import count
from typing import NamedTuple

from haptic_accel.core.coupling.engagement import EngagementParameters
from haptic_accel.core.network.channel import ChannelParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.process import module_command
from haptic_accel.graph.domain import HIGHEST_FREE_DOMAIN
from haptic_accel.graph.relaying import CHANGED, PORTS, assignments_of
from haptic_accel.graph.stop_signal import own_domain, used_domains
from haptic_accel.links import bound
from haptic_accel.setup.arguments import SIMULATED, SURFACES, GraphArguments, check_both_arms
from haptic_accel.setup.processes import Process, graph

HOST = "127.0.0.1"

LAST_PORT = 7300
"""Upper limit of the search for free ports, where the ports of links begin."""

SILENCE = 3 * EngagementParameters.timeout
"""Time without datagrams after which arms disengage and the playout of vibration restarts, s, with
a margin for a busy machine."""

ANSWER_TIME = 10.0
"""Time-out for the relay to report its network, s; a busy machine takes seconds to start
Python."""


class RelayError(RuntimeError):
    """Error: the relay between the two sides does not run."""


class RelayProcess:
    """Relay in a separate process, because other threads of a program would add to its delay.

    Parameters
    ----------
    ports : tuple of (int, int)
        First port of the master's and of the slave's side.
    network : ChannelParameters

    Raises
    ------
    RelayError
        The relay does not start.
    """

    def __init__(self, ports: tuple[int, int], network: ChannelParameters) -> None:
        master, slave = (f"{HOST}:{port}" for port in ports)
        self._process = subprocess.Popen(
            [
                *module_command("haptic_accel.graph.relaying"),
                *(f"master:={master}", f"slave:={slave}"),
                *assignments_of(network),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # not ended by Ctrl-C, but in order by its program
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self._network = network
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()
        try:
            self._wait(network)
        except RelayError:
            self.close()
            raise

    def change(self, network: ChannelParameters) -> None:
        """Change the network; the delay increases at the rate `RISE` of the relay.

        The played vibration follows a longer delay at once, but a shorter one only within seconds,
        as it waits for the next late datagram; see `reconnect`.

        Raises
        ------
        RelayError
            The relay has ended.
        """
        assert self._process.stdin
        with suppress(BrokenPipeError):  # the relay has ended; the wait for its answer fails
            self._process.stdin.write(" ".join(assignments_of(network)) + "\n")
            self._process.stdin.flush()
        self._wait(network)

    def reconnect(self, network: ChannelParameters) -> None:
        """Interrupt the relay, then use a changed network; both sides engage again.

        The arms disengage, and engage again half a second later in the same position. The
        vibration then has the new delay, even if it is shorter.

        Raises
        ------
        RelayError
            The relay has ended.
        """
        transit = self._network.delay + self._network.jitter
        self.change(replace(network, loss=1.0))
        time.sleep(SILENCE + transit)
        self.change(network)

    def close(self) -> None:
        """End the relay."""
        self._process.kill()  # the relay has no state to save
        self._reader.join()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream
            with suppress(BrokenPipeError):
                stream.close()

    def _wait(self, network: ChannelParameters) -> None:
        """Wait until the relay reports a network."""
        expected = CHANGED + " ".join(assignments_of(network))
        try:
            line = self._lines.get(timeout=ANSWER_TIME)
        except queue.Empty:
            raise RelayError(f"relay: no answer within {ANSWER_TIME:g} s") from None
        if line != expected:
            raise RelayError(f"relay: {line or 'has ended'}")
        self._network = network

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            self._lines.put(line.rstrip("\n"))
        self._lines.put("")


class NetworkedGraph(NamedTuple):
    """Both sides of a graph, and the network between them.

    Attributes
    ----------
    processes : list of Process
        Processes of both sides, for one `Supervisor`. Those of the slave's side have a separate
        ROS domain.
    relay : RelayProcess
        Simulated network, whose parameters can be changed at any time.
    slave_domain : int
        ROS domain of the slave's side.
    """

    processes: list[Process]
    relay: RelayProcess
    slave_domain: int


@contextmanager
def networked_graph(
    arguments: GraphArguments, network: ChannelParameters, *, slave_domain: int | None = None
) -> Iterator[NetworkedGraph]:
    """Run a relay, and yield the processes of the two sides that it connects.

    Topics of the slave's side stay in its own ROS domain, as if on another host. If a bag is
    recorded, the slave's side records a second one, whose name ends in ``-slave``.

    Parameters
    ----------
    arguments : GraphArguments
        Arguments with both arms.
    network : ChannelParameters
        Network at the start.
    slave_domain : int, optional
        ROS domain of the slave's side; default: the next one without a graph.

    Raises
    ------
    ParameterError
        An argument is not possible with two hosts, or unusable.
    RelayError
        The relay does not start.
    """
    check_both_arms(arguments)
    domain = _free_domain() if slave_domain is None else slave_domain
    ports = _free_ports()
    master, slave = sides(arguments, ports)
    processes = [*graph(master), *(replace(each, domain=domain) for each in graph(slave))]
    relay = RelayProcess(ports, network)
    try:
        yield NetworkedGraph(processes, relay, domain)
    finally:
        relay.close()


def sides(
    arguments: GraphArguments, ports: tuple[int, int]
) -> tuple[GraphArguments, GraphArguments]:
    """Return the arguments of the master's and of the slave's side behind a relay.

    Parameters
    ----------
    arguments : GraphArguments
        Arguments with both arms.
    ports : tuple of (int, int)
        First port of either side.
    """
    peers = [f"{HOST}:{port}" for port in ports]
    # Device and surface of the other side are arguments of the peer.
    operator = replace(arguments, slave=SIMULATED, surface=SURFACES[0])
    master = replace(operator, side="master", peer=peers[0])
    bag = arguments.bag and f"{arguments.bag}-slave"
    slave = replace(arguments, side="slave", peer=peers[1], master=SIMULATED, scope=False, bag=bag)
    return master, slave


def _free_ports() -> tuple[int, int]:
    """Return two free first ports whose next ports are also free."""
    free = [port for port in range(PORTS[0], LAST_PORT, 2) if _is_free(port)]
    if len(free) < len(PORTS):
        raise ParameterError(f"ports {PORTS[0]} to {LAST_PORT - 1}/udp of {HOST}: none are free")
    return free[0], free[1]


def _is_free(port: int) -> bool:
    opened: list[socket.socket] = []
    try:
        opened += (bound(HOST, each) for each in (port, port + 1))
    except ParameterError:
        return False
    finally:
        for each in opened:
            each.close()
    return True


def _free_domain() -> int:
    """Return the next ROS domain after the environment's in which no graph runs."""
    own, used = own_domain(), used_domains()
    domains = ((own + step) % (HIGHEST_FREE_DOMAIN + 1) for step in count(1))
    return next(domain for domain in domains if domain not in used)
