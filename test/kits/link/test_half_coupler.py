# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two graphs on this machine, each with one arm, as on two hosts."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

from haptic_accel.kits.link.datagrams import LINK, LocalEnd
from haptic_accel.kits.link.endpoint import VERSION, Endpoint, Motion, State
from observing import Observer
from running import Command, Start, nodes_of, reserved_domain, wait_until

SIDES = ("master", "slave")

QUIETER = "rate:=500"
"""Both graphs share the cores of one machine."""

APART = "composed:=false"
UNRECORDED = "record:=false"

Ask = Callable[..., tuple[int, str]]


class Hosts:
    """Both graphs, each in a ROS domain of its own."""

    def __init__(
        self, environment: pytest.MonkeyPatch, start: Start, ask: Ask, domains: list[int]
    ) -> None:
        self._environment, self._start, self._ask = environment, start, ask
        self.domains = dict(zip(SIDES, domains, strict=True))
        # The ports of the link follow from the namespace: those of a graph by hand stay free.
        self.namespace = f"namespace:=of_{domains[0]}"

    def teleop(self, side: str, *words: str) -> Command:
        """Start the graph of a side."""
        self._environment.setenv("ROS_DOMAIN_ID", str(self.domains[side]))
        words = (f"side:={side}", "peer:=127.0.0.1", QUIETER, *words)
        return self._start("teleop", self.namespace, *words)

    def ask(self, side: str, verb: str, *words: str) -> str:
        """Run a verb on the host of a side; return what it says."""
        self._environment.setenv("ROS_DOMAIN_ID", str(self.domains[side]))
        status, said = self._ask(verb, self.namespace, *words)
        assert status == 0, said
        return said


@pytest.fixture
def hosts(
    haptic_accel: Start, ask: Ask, domain: int, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Hosts]:
    with reserved_domain() as other:
        yield Hosts(monkeypatch, haptic_accel, ask, [domain, other])


def test_two_hosts_couple_stop_and_lose_each_other(hosts: Hosts, tmp_path: Path) -> None:
    graphs = {"master": hosts.teleop("master", APART, UNRECORDED)}
    graphs["slave"] = hosts.teleop("slave", "bag:=bag")
    for graph in graphs.values():
        graph.wait_for("engaged$")
    with ExitStack() as stack:
        own = {side: closing(Observer(hosts.domains[side])) for side in SIDES}
        _exchange({side: stack.enter_context(each) for side, each in own.items()})
        _stop_and_release(hosts, graphs)
        _kill_and_return(hosts, graphs)
    for graph in graphs.values():
        assert graph.end(signal.SIGINT) == 0, graph.text
    following = f"next: haptic-accel analyze {tmp_path / 'bag'} PEERS_BAG"
    assert graphs["slave"].lines[-1] == following


def _exchange(observers: dict[str, Observer]) -> None:
    """Check that forces flow on both hosts, which know what the network does."""
    for side, observer in observers.items():
        observer.status(f"{side}_device", least={"arm force count": 1000})
        values = observer.status("coupler", least={"packets received": 500}, engaged="true")
        assert abs(float(values["clock offset (ms)"])) <= float(values["clock offset bound (ms)"])
        assert 0.0 < float(values["stiffness (N/m)"]) <= 250.0
    observers["master"].status("master_device", least={"actuator force count": 1000})
    played = observers["master"].status("coupler", least={"samples played": 1000})
    assert float(played["samples true (%)"]) > 0.0


def _stop_and_release(hosts: Hosts, graphs: dict[str, Command]) -> None:
    """Stop one host, which stops the other, and release each by itself."""
    seen = {side: len(graph.lines) for side, graph in graphs.items()}
    assert hosts.ask("master", "estop").startswith("emergency stop: the device is without force")
    # The other host may hear that the arm was let go before it hears of the stop.
    for side, reason in (("master", "emergency stop"), ("slave", "(emergency stop|the peer dis)")):
        graph = graphs[side]
        graph.wait_for(f"uncoupled: {reason}", seen[side])
        graph.wait_for(f"{side}_device.*no force until it is released", seen[side])
    for side in ("slave", "master"):
        assert f"{side}_device" in hosts.ask(side, "estop", "release:=true")
    for side, graph in graphs.items():
        graph.wait_for("engaged$", seen[side])


def _kill_and_return(hosts: Hosts, graphs: dict[str, Command]) -> None:
    """Kill one host, which frees the arm of the other, arm that alone, and let it return."""
    seen = len(graphs["slave"].lines)
    lost = graphs.pop("master")
    for pid in (lost.process.pid, *nodes_of(hosts.domains["master"]).values()):
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    lost.end()
    graphs["slave"].wait_for("uncoupled: waiting for the peer's packets", seen)
    assert hosts.ask("slave", "control", "arm:=true") == "slave_device: armed"
    graphs["master"] = hosts.teleop("master", UNRECORDED)
    for side, after in (("master", 0), ("slave", seen)):
        graphs[side].wait_for("engaged$", after)


def packet(side: str) -> bytes:
    data = Endpoint(side, 1000.0, 7).outgoing(State(), Motion(), 0.0, 0.0, 0)
    assert data
    return data


def test_packets_that_cannot_be_used_are_refused_in_one_line_each(
    start: Start, observer: Observer, domain: int
) -> None:
    words = [word for each in ("side:=slave", "coupling:=passive") for word in ("-p", each)]
    half = start("-m", "haptic_accel.kits.link.half_coupler", "--ros-args", *words)
    link = LocalEnd(LINK, domain, "")
    other_version = bytearray(packet("master"))
    other_version[4] = VERSION + 1
    refused = {
        "both hosts are side:=slave: one must be the other": packet("slave"),
        f"the peer's packets have version {VERSION + 1}: must be {VERSION}": bytes(other_version),
    }
    for reason, data in refused.items():
        wait_until(lambda d=data, reason=reason: link.send(d) and reason in half.text, reason)
        for _ in range(20):
            link.send(data)
        observer.status("coupler", reason)
    link.close()
    assert half.end(signal.SIGINT) == 0
    assert [half.text.count(reason) for reason in refused] == [1, 1]
