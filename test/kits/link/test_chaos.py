# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Surprises between two hosts, each a network namespace with a graph of its own."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from signal import SIGINT

import psutil
import pytest

from haptic_accel.bags.reading import read_bag
from haptic_accel.core import topics
from haptic_accel.core.sampling import NANOSECONDS, RELEASED
from haptic_accel.kits.link.addresses import FIRST_PORTS
from haptic_accel.kits.link.datagrams import write_new_key
from running import Command, StallWatch, Start
from wires import ADDRESSES, DEVICE, Wire, reason_against

WITHOUT = reason_against() or ""
pytestmark = [pytest.mark.slow, pytest.mark.skipif(bool(WITHOUT), reason=WITHOUT)]

OPERATOR, ROBOT = "operator", "robot"
ENDS = {OPERATOR: (0, "master", topics.MASTER), ROBOT: (1, "slave", topics.SLAVE)}

LATEST = 2 * RELEASED
"""Time after which a force without a peer must have ended, s: the time-out, and as much again for
the samples in which it is seen and the processes that were held up."""

OUTAGE = 2.0
"""Time for which something is missing, s."""

REPLAY = f"""
import itertools, socket, time
port = {FIRST_PORTS["udp"] + 1}
with socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM) as heard:
    heard.bind(("{DEVICE}", 0x0800))
    kept = []
    while len(kept) < 1000:
        frame = heard.recv(2048)
        if frame[9] == socket.IPPROTO_UDP and frame[22:24] == port.to_bytes(2, "big"):
            kept.append(frame[28:])
print("recorded", flush=True)
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as replay:
    for datagram in itertools.cycle(kept):
        replay.sendto(datagram, ("{ADDRESSES[1]}", port))
        time.sleep(1e-3)
"""
"""Records what the operator's link sends, then sends it to the robot's for ever."""


class Hosts:
    """The graphs of both hosts, and the wire between them."""

    def __init__(self, wire: Wire, start: Start, folder: Path) -> None:
        self.wire, self._start, self._folder = wire, start, folder
        self.graphs: dict[str, Command] = {}
        self.bags: dict[str, Path] = {}
        for pair in ("pair", "other"):
            folders = [folder / pair / host for host in ENDS]
            for each in folders:
                each.mkdir(parents=True)
            write_new_key(*folders)

    def start(self, host: str, keys: str = "pair") -> Command:
        """Start the graph of a host."""
        end, side, _ = ENDS[host]
        self.bags[host] = self._folder / f"{host}_{time.monotonic_ns()}"
        words = (
            *("teleop", f"side:={side}", f"peer:={ADDRESSES[1 - end]}", "rate:=500"),
            *("controller:=inverse", "record:=true"),
            *(f"keys:={self._folder / keys / host}", f"bag:={self.bags[host]}"),
        )
        graph = (sys.executable, "-m", "haptic_accel.cli.main", *words)
        become = "import os, sys; os.execvp(sys.argv[1], sys.argv[1:])"
        self.graphs[host] = self._start("-c", become, *self.wire.inside(end, graph))
        return self.graphs[host]

    def engage(self) -> None:
        """Start both, and wait until both arms are coupled."""
        for host in ENDS:
            self.start(host)
        for graph in self.graphs.values():
            graph.wait_for("engaged$")

    def kill(self, host: str) -> None:
        """Kill all processes of a host's graph, of which none can end anything in order."""
        parent = psutil.Process(self.graphs[host].process.pid)
        for process in [*parent.children(recursive=True), parent]:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self.graphs[host].end()

    def run(self, host: str, *words: str) -> None:
        """Run a command on a host."""
        subprocess.run(self.wire.inside(ENDS[host][0], words), check=True)

    @contextmanager
    def outage(self, *hosts: str) -> Iterator[None]:
        """Check that the forces of hosts end in time after what is done inside, and come back.

        Inside, the act; after it the hosts must let go, and be free for `OUTAGE`.
        """
        self._seen = {host: len(self.graphs[host].lines) for host in hosts}
        yield
        self._since = time.time_ns()
        for host, seen in self._seen.items():
            self.graphs[host].wait_for("uncoupled: ", seen)
        time.sleep(OUTAGE)
        for host, seen in self._seen.items():
            lines = self.graphs[host].lines[seen:]
            assert not any(line.endswith("engaged") for line in lines), lines

    def come_back(self, stalls: StallWatch) -> None:
        """Check that all arms are coupled again, and how soon the forces had ended."""
        for host, graph in self.graphs.items():
            graph.wait_for("engaged$", self._seen.get(host, 0))
        for host, graph in self.graphs.items():
            assert graph.end(SIGINT) == 0, graph.text
            if host in self._seen:
                (first, last), *later = read_bag(self.bags[host]).coupled(ENDS[host][2])
                assert first < self._since
                assert (last - self._since) / NANOSECONDS < LATEST + stalls.longest
                assert later
                assert later[0][0] > self._since + OUTAGE * NANOSECONDS


@pytest.fixture
def hosts(start: Start, tmp_path: Path) -> Iterator[Hosts]:
    with Wire() as wire:
        found = Hosts(wire, start, tmp_path)
        found.engage()
        yield found


def test_a_cable_that_is_out_frees_both_arms_until_it_is_back(hosts: Hosts) -> None:
    with StallWatch() as stalls:
        with hosts.outage(OPERATOR, ROBOT):
            hosts.run(ROBOT, "ip", "link", "set", DEVICE, "down")
        hosts.run(ROBOT, "ip", "link", "set", DEVICE, "up")
        hosts.come_back(stalls)


def test_a_peer_that_is_killed_frees_the_arm_until_it_is_back_with_the_key(hosts: Hosts) -> None:
    with StallWatch() as stalls:
        with hosts.outage(OPERATOR):
            hosts.kill(ROBOT)
        stranger = hosts.start(ROBOT, keys="other")
        for graph in hosts.graphs.values():
            graph.wait_for("do not have this link's key")
        stranger.wait_for("waiting for the peer's packets")
        time.sleep(OUTAGE)
        assert not any(line.endswith("engaged") for line in stranger.lines)
        hosts.kill(ROBOT)
        hosts.start(ROBOT)
        hosts.come_back(stalls)


def test_what_was_recorded_and_is_sent_again_moves_nothing_and_ends_nothing(hosts: Hosts) -> None:
    words = hosts.wire.inside(ENDS[ROBOT][0], [sys.executable, "-c", REPLAY])
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as replay:
        assert replay.stdout
        replay.stdout.readline()
        seen = len(hosts.graphs[ROBOT].lines)
        time.sleep(OUTAGE)
        assert not any("uncoupled" in line for line in hosts.graphs[ROBOT].lines[seen:])
        with StallWatch() as stalls:
            with hosts.outage(ROBOT):
                hosts.kill(OPERATOR)
            hosts.start(OPERATOR)
            hosts.come_back(stalls)
        assert replay.poll() is None
        replay.kill()
