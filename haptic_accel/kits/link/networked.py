# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both sides of a graph on this machine, with a simulated network between the arms."""

from __future__ import annotations

import select
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import replace
from itertools import count

from haptic_accel import ChannelParameters, GraphArguments, ParameterError
from haptic_accel.core import EngagementParameters
from haptic_accel.core.process import module_command
from haptic_accel.graph import (
    HIGHEST_FREE_DOMAIN,
    NetworkedGraph,
    RelayError,
    own_domain,
    used_domains,
)
from haptic_accel.kits.link.addresses import bound
from haptic_accel.kits.link.relaying import CHANGED, PORTS, assignments_of
from haptic_accel.setup import SIMULATED, SURFACES, check_both_arms, graph

HOST = "127.0.0.1"

LAST_PORT = 7300
"""Upper limit of the search for free ports, where the ports of links begin."""

SILENCE = 3 * EngagementParameters.timeout
"""Time without datagrams after which arms disengage and the playout of vibration restarts, s, with
a margin for a busy machine."""

ANSWER_TIME = 10.0
"""Time-out for the relay to report its network, s; a busy machine takes seconds to start
Python."""


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
                *module_command("haptic_accel.kits.link.relaying"),
                *(f"master:={master}", f"slave:={slave}"),
                *assignments_of(network),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,  # not ended by Ctrl-C, but in order by its program
        )
        self._network = network
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
        with suppress(BrokenPipeError), self._process:  # waits, and closes the streams
            pass

    def _wait(self, network: ChannelParameters) -> None:
        """Wait until the relay reports a network."""
        expected = CHANGED + " ".join(assignments_of(network))
        answers = self._process.stdout
        assert answers
        if not select.select([answers], [], [], ANSWER_TIME)[0]:
            raise RelayError(f"relay: no answer within {ANSWER_TIME:g} s")
        # The relay writes whole lines, and one for each network.
        line = answers.readline().rstrip("\n")
        if line != expected:
            raise RelayError(f"relay: {line or 'has ended'}")
        self._network = network


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
    with suppress(ParameterError), closing(bound(HOST, port)), closing(bound(HOST, port + 1)):
        return True
    return False


def _free_domain() -> int:
    """Return the next ROS domain after the environment's in which no graph runs."""
    own, used = own_domain(), used_domains()
    domains = ((own + step) % (HIGHEST_FREE_DOMAIN + 1) for step in count(1))
    return next(domain for domain in domains if domain not in used)
