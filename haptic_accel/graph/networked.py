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
from haptic_accel.graph.locks import HIGHEST_FREE_DOMAIN
from haptic_accel.graph.relaying import CHANGED, PORTS, words_of
from haptic_accel.graph.stop_signal import own_domain, used_domains
from haptic_accel.links.addresses import bound
from haptic_accel.setup.arguments import SIMULATED, SURFACES, GraphArguments, check_both_arms
from haptic_accel.setup.processes import Process, graph

HOST = "127.0.0.1"

LAST_PORT = 7300
"""Port from which those of links begin."""

SILENCE = 3 * EngagementParameters.timeout
"""Time without datagrams in which arms let go and the playout of vibration begins again, s, with a
margin for a busy machine."""

ANSWER_TIME = 10.0
"""Longest time until the relay states its network, s: a busy machine starts Python in seconds."""


class RelayError(RuntimeError):
    """The relay between the sides does not run."""


class RelayProcess:
    """Relay in a process of its own: another program's threads would add to its delay.

    Parameters
    ----------
    ports : tuple of (int, int)
        First port of the master's and of the slave's side.
    network : ChannelParameters

    Raises
    ------
    RelayError
        It does not start.
    """

    def __init__(self, ports: tuple[int, int], network: ChannelParameters) -> None:
        master, slave = (f"{HOST}:{port}" for port in ports)
        self._process = subprocess.Popen(
            [
                *module_command("haptic_accel.graph.relaying"),
                *(f"master:={master}", f"slave:={slave}"),
                *words_of(network),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # Ctrl-C is for the program that stops the graph in order
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

        The played vibration follows a longer delay at once, but a shorter one within seconds, as
        it waits for the next late datagram: see `begin_anew`.

        Raises
        ------
        RelayError
            The relay has ended.
        """
        assert self._process.stdin
        with suppress(BrokenPipeError):  # then no answer comes
            self._process.stdin.write(" ".join(words_of(network)) + "\n")
            self._process.stdin.flush()
        self._wait(network)

    def begin_anew(self, network: ChannelParameters) -> None:
        """Interrupt the relay, then use a changed network; both sides engage again.

        The arms let go, and engage again half a second later, where they were. From then on the
        vibration has the new delay, also a shorter one.

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
        self._process.kill()  # it holds nothing
        self._reader.join()
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            assert stream
            with suppress(BrokenPipeError):
                stream.close()

    def _wait(self, network: ChannelParameters) -> None:
        """Wait until the relay states a network."""
        expected = CHANGED + " ".join(words_of(network))
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
        Processes of both sides, for one `Supervisor`. Those of the slave's side have a ROS domain
        of their own.
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
    arguments: GraphArguments,
    network: ChannelParameters,
    *,
    slave_domain: int | None = None,
) -> Iterator[NetworkedGraph]:
    """Run a relay, and yield the processes of both sides for it.

    Topics of the slave's side stay in its own ROS domain, as if it were on another host. With a
    bag, its side records a second one, whose name ends in ``-slave``.

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
        An argument cannot be on two hosts, or is not usable.
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
    # Device and surface of the other side belong to the peer.
    operator = replace(arguments, slave=SIMULATED, surface=SURFACES[0])
    master = replace(operator, side="master", peer=peers[0])
    bag = arguments.bag and f"{arguments.bag}-slave"
    slave = replace(arguments, side="slave", peer=peers[1], master=SIMULATED, scope=False, bag=bag)
    return master, slave


def _free_ports() -> tuple[int, int]:
    """Return two first ports that are free, as is the port behind each."""
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
    """Return the next ROS domain after that of the environment in which no graph runs."""
    own, used = own_domain(), used_domains()
    domains = ((own + step) % (HIGHEST_FREE_DOMAIN + 1) for step in count(1))
    return next(domain for domain in domains if domain not in used)
