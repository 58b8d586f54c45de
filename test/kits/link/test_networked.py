# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Both sides of a graph on this machine, over a simulated network."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import pytest

from haptic_accel.core.network import ChannelParameters
from haptic_accel.core.parameters import ParameterError
from haptic_accel.graph.supervisor import Outcome, Supervisor
from haptic_accel.kits.link.networked import RelayError, networked_graph, sides
from haptic_accel.setup.arguments import GraphArguments
from observing import Observer
from running import on_thread, reserved_domain, wait_until

DELAY = 0.03


def test_either_side_has_its_own_device_and_port() -> None:
    both = GraphArguments(master="pointer", slave="virtual", bag="bags/a", scope=True)
    master, slave = sides(both, (7200, 7210))
    assert (master.master, master.slave, master.peer) == ("pointer", "simulated", "127.0.0.1:7200")
    assert (slave.master, slave.slave, slave.peer) == ("simulated", "virtual", "127.0.0.1:7210")
    assert (master.bag, slave.bag) == ("bags/a", "bags/a-slave")
    assert (master.scope, slave.scope) == (True, False)
    assert slave.surface == "workshop"


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (GraphArguments(side="master", peer="127.0.0.1"), "side = 'master': must be empty"),
        (GraphArguments(master="replay", replay="bag"), "master = 'replay': not with"),
    ],
)
def test_what_cannot_be_on_two_hosts_is_refused(arguments: GraphArguments, named: str) -> None:
    with (
        pytest.raises(ParameterError, match=named),
        networked_graph(arguments, ChannelParameters(), slave_domain=1),
    ):
        raise AssertionError


def test_a_relay_that_has_ended_is_told() -> None:
    arguments = GraphArguments(record=False)
    with networked_graph(arguments, ChannelParameters(), slave_domain=1) as networked:
        networked.relay.change(ChannelParameters(delay=0.1))
        networked.relay.close()
        with pytest.raises((RelayError, ValueError)):
            networked.relay.change(ChannelParameters())


@contextmanager
def running(supervisor: Supervisor) -> Iterator[list[Outcome]]:
    """Run a graph on a thread of its own; yield its outcome once it has ended."""
    outcomes: list[Outcome] = []
    with on_thread(lambda stop: outcomes.append(supervisor.run(stop))):
        yield outcomes


@pytest.mark.slow
def test_the_delay_between_the_arms_is_the_one_asked_for(domain: int, tmp_path: Path) -> None:
    arguments = GraphArguments(rate=500.0, record=False)
    lines: list[str] = []
    with (
        reserved_domain() as other,
        networked_graph(arguments, ChannelParameters(DELAY), slave_domain=other) as networked,
        running(Supervisor(networked.processes, lambda _, line: lines.append(line))) as outcomes,
        closing(Observer(domain)) as one,
        closing(Observer(other)) as two,
    ):
        for observer in (one, two):
            observer.status("coupler", least={"packets received": 500}, engaged="true")
        relay = networked.relay
        changes = (0.08, relay.change), (0.0, relay.reconnect), (DELAY, relay.change)
        for delay, change in changes:
            change(ChannelParameters(delay))
            for observer in (one, two):
                wait_until(partial(near, observer, delay), "\n".join(lines))
                observer.status("coupler", engaged="true")
    (outcome,) = outcomes
    assert not outcome.failed, "\n".join(lines)
    assert {f"link@{other}", "link"} < set(outcome.statuses)


def near(observer: Observer, delay: float) -> bool:
    """Return whether a side measures a one-way delay, and some ms of the loops."""
    values = observer.status("coupler")
    return 1e3 * delay <= float(values["one-way delay (ms)"]) < 1e3 * delay + 10.0


def test_domains_with_nodes_are_not_taken() -> None:
    from haptic_accel.kits.link.datagrams import LINK, LocalEnd

    own = int(os.environ.get("ROS_DOMAIN_ID") or 0)
    with (
        closing(LocalEnd(LINK, own + 1, "/of_a_test")),
        networked_graph(GraphArguments(record=False), ChannelParameters()) as networked,
    ):
        assert networked.slave_domain not in (own, own + 1)
        assert {each.domain for each in networked.processes} == {None, networked.slave_domain}
