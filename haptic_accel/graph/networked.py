# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both sides of a graph on this machine, if the kit of two hosts is installed."""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import NamedTuple, Protocol

from haptic_accel.core.network import ChannelParameters, provided
from haptic_accel.setup.arguments import GraphArguments
from haptic_accel.setup.processes import Process


class RelayError(RuntimeError):
    """Error: the relay between the two sides does not run."""


class Relay(Protocol):
    """Simulated network between two running sides.

    Both methods raise a `RelayError` if the relay has ended.
    """

    def change(self, network: ChannelParameters) -> None:
        """Change the network; the delay rises gradually, so that the arms stay engaged."""

    def reconnect(self, network: ChannelParameters) -> None:
        """Interrupt the relay, then use a changed network; both sides engage again."""


class NetworkedGraph(NamedTuple):
    """Both sides of a graph, and the network between them.

    Attributes
    ----------
    processes : list of Process
        Processes of both sides, for one `Supervisor`. Those of the slave's side have a separate
        ROS domain.
    relay : Relay
        Simulated network, whose parameters can be changed at any time.
    slave_domain : int
        ROS domain of the slave's side.
    """

    processes: list[Process]
    relay: Relay
    slave_domain: int


def networked_graph(
    arguments: GraphArguments, network: ChannelParameters
) -> AbstractContextManager[NetworkedGraph]:
    """Run a relay, and yield the processes of the two sides that it connects.

    Parameters
    ----------
    arguments : GraphArguments
        Arguments with both arms.
    network : ChannelParameters
        Network at the start.

    Raises
    ------
    ParameterError
        An argument is not possible with two hosts, or the kit of two hosts is not installed.
    RelayError
        The relay does not start.
    """
    sides: AbstractContextManager[NetworkedGraph] = provided("graph")(arguments, network)
    return sides
