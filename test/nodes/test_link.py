"""Two links on this machine, as on two hosts: each with a ROS domain of its own."""

from __future__ import annotations

import os
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import pytest

from haptic_accel.core.process import DONE, EMERGENCY, WRONG_ARGUMENTS
from haptic_accel.links.local import COUPLER, LONGEST, LocalEnd
from running import Command, reserved_domain, wait_until

SIDES = ("master", "slave")
PEER = "127.0.0.1"


class Pair:
    """Two hosts on this machine: the couplers' ends, and the links once they are started."""

    def __init__(
        self, start: Callable[..., Command], ends: dict[str, LocalEnd], domains: dict[str, int]
    ) -> None:
        self.ends = ends
        self.links: dict[str, Command] = {}
        self._start, self._domains = start, domains

    def start(self, side: str, folder: Path, **parameters: str) -> Command:
        """Start the link of one side."""
        values = {"side": side, "peer": PEER, **parameters}
        lines = "".join(f'    {name}: "{value}"\n' for name, value in values.items())
        file = folder / f"{side}.yaml"
        file.write_text(f"/**/link:\n  ros__parameters:\n{lines}")
        os.environ["ROS_DOMAIN_ID"] = str(self._domains[side])
        self.links[side] = self._start(
            "-m", "haptic_accel.nodes.link", "--ros-args", "--params-file", str(file)
        )
        return self.links[side]

    def meets(self) -> None:
        """Send both ways until both have received what the other sent, whole."""
        sent = {side: side.encode().ljust(LONGEST, b".") for side in SIDES}
        missing = dict(zip(SIDES, reversed(SIDES), strict=True))

        def received() -> bool:
            for side, end in self.ends.items():
                end.send(sent[side])
            for side in list(missing):
                if taken := self.ends[side].take():
                    assert set(taken) == {sent[missing.pop(side)]}
            return not missing

        wait_until(received, "datagrams both ways")

    def silent(self) -> bool:
        """Return whether nothing has come for any coupler."""
        return not any(end.take() for end in self.ends.values())


@pytest.fixture
def pair(
    start: Callable[..., Command], domain: int, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Pair]:
    with ExitStack() as stack:
        domains = {"master": domain, "slave": stack.enter_context(reserved_domain())}
        ends = {
            side: stack.enter_context(closing(LocalEnd(COUPLER, number, "")))
            for side, number in domains.items()
        }
        yield Pair(start, ends, domains)


def free_ports() -> str:
    """Return the peer with two ports in a row that nobody has."""
    with ExitStack() as stack:
        while True:
            one, two = (
                stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                for _ in range(2)
            )
            one.bind((PEER, 0))
            port = one.getsockname()[1]
            try:
                two.bind((PEER, port + 1))
            except OSError:
                continue
            return f"{PEER}:{port}"


def test_datagrams_cross_and_a_link_that_was_killed_is_met_again(
    pair: Pair, tmp_path: Path
) -> None:
    peer = free_ports()
    first = int(peer.rpartition(":")[2])
    pair.start("slave", tmp_path, peer=peer)
    master = pair.start("master", tmp_path, peer=peer)
    line = master.wait_for(r"\[link\]: master at 127\.0\.0\.1")
    assert f"port {first}/udp" in line
    assert f"port {first + 1}/udp" in line
    pair.meets()
    master.process.send_signal(EMERGENCY)
    pair.links["slave"].end(signal.SIGKILL)
    pair.start("slave", tmp_path, peer=peer)
    pair.meets()
    assert master.end(signal.SIGTERM) == DONE
    assert [line for line in master.lines if "is heard" in line][1:] == []


def test_a_port_of_another_program_is_refused_in_one_line(pair: Pair, tmp_path: Path) -> None:
    peer = free_ports()
    port = int(peer.rpartition(":")[2])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind((PEER, port))
        link = pair.start("master", tmp_path, peer=peer)
        assert link.end() == WRONG_ARGUMENTS
    (line,) = link.lines
    assert line.startswith(f"link: port {port}/udp of 127.0.0.1: address already in use")


def test_a_peer_that_is_not_heard_is_said_with_what_to_check(pair: Pair, tmp_path: Path) -> None:
    link = pair.start("slave", tmp_path, peer=free_ports())
    line = link.wait_for("nothing heard for 5 s")
    assert "side:=master transport:=dds" in line
    assert "/udp" in line


def test_without_a_peer_nothing_starts(pair: Pair, tmp_path: Path) -> None:
    link = pair.start("master", tmp_path, peer="")
    assert link.end() == WRONG_ARGUMENTS
    assert link.lines == ["link: peer = '': must be HOST or HOST:PORT of the other host"]
