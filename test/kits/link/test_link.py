# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Two links on this machine, as on two hosts: each with a ROS domain of its own."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import psutil
import pytest

from haptic_accel.core.process import DONE, EMERGENCY, WRONG_ARGUMENTS
from haptic_accel.kits.link.addresses import Route
from haptic_accel.kits.link.datagrams import (
    COUPLER,
    LONGEST_DATAGRAM,
    Authenticator,
    LocalEnd,
    read_key,
    write_new,
    write_new_key,
)
from haptic_accel.kits.link.link import REPEAT, SEARCH_PERIOD, SILENCE, PeerMonitor, advice
from haptic_accel.kits.link.zenoh import AUTHORITY
from running import Command, Start, free_ports, reserved_domain, wait_until

SIDES = ("master", "slave")
PEER = "127.0.0.1"


class Pair:
    """Two hosts on this machine: the couplers' ends, and the links once they are started."""

    def __init__(self, start: Start, ends: dict[str, LocalEnd], domains: dict[str, int]) -> None:
        self.ends = ends
        self.links: dict[str, Command] = {}
        self.sent = {side: side.encode().ljust(LONGEST_DATAGRAM, b".") for side in SIDES}
        self._start, self._domains = start, domains

    def start(self, side: str, folder: Path, **parameters: str | bool) -> Command:
        """Start the link of one side."""
        values = {"side": side, "peer": PEER, **parameters}
        lines = "".join(f"    {name}: {json.dumps(value)}\n" for name, value in values.items())
        file = folder / f"{side}.yaml"
        file.write_text(f"/**/link:\n  ros__parameters:\n{lines}")
        os.environ["ROS_DOMAIN_ID"] = str(self._domains[side])
        words = ("haptic_accel.kits.link.link", "--ros-args", "--params-file", str(file))
        self.links[side] = self._start("-m", *words)
        return self.links[side]

    def meets(self) -> None:
        """Send both ways until both have received what the other sent, whole."""
        sent = self.sent
        missing = dict(zip(SIDES, reversed(SIDES), strict=True))

        def received() -> bool:
            for side, end in self.ends.items():
                end.send(sent[side])
            for side in list(missing):
                if taken := self.ends[side].drain():
                    assert set(taken) == {sent[missing.pop(side)]}
            return not missing

        wait_until(received, "datagrams both ways")

    def received(self) -> set[bytes]:
        """Return what has come for the couplers since the last look, each datagram once."""
        return {datagram for end in self.ends.values() for datagram in end.drain()}


@pytest.fixture
def pairs(start: Start) -> Iterator[Callable[[], Pair]]:
    """Make pairs of hosts, each with ROS domains of its own."""
    with ExitStack() as stack:

        def made() -> Pair:
            domains = {side: stack.enter_context(reserved_domain()) for side in SIDES}
            own = {side: LocalEnd(COUPLER, number, "") for side, number in domains.items()}
            ends = {side: stack.enter_context(closing(end)) for side, end in own.items()}
            return Pair(start, ends, domains)

        yield made


@pytest.fixture
def pair(pairs: Callable[[], Pair]) -> Pair:
    return pairs()


@pytest.mark.smoke
def test_datagrams_cross_and_a_link_that_was_killed_is_met_again(
    pair: Pair, tmp_path: Path
) -> None:
    peer = free_ports()
    first = int(peer.rpartition(":")[2])
    pair.start("slave", tmp_path, peer=peer)
    master = pair.start("master", tmp_path, peer=peer)
    pair.meets()
    line = master.wait_for(r"\[link\]: master at 127\.0\.0\.1")
    assert f"port {first}/udp" in line
    assert f"port {first + 1}/udp" in line
    sockets = psutil.Process(master.process.pid).net_connections("udp")
    assert [(each.laddr.ip, each.laddr.port) for each in sockets] == [(PEER, first)]
    master.process.send_signal(EMERGENCY)
    pair.links["slave"].end(signal.SIGKILL)
    pair.received()  # what has come before must not pass for what the new link brings
    pair.start("slave", tmp_path, peer=peer)
    pair.meets()
    assert master.end(signal.SIGTERM) == DONE
    assert [line for line in master.lines if "is heard" in line][1:] == []


@pytest.mark.quiet
@pytest.mark.smoke
def test_without_a_peer_nothing_starts(pair: Pair, tmp_path: Path) -> None:
    link = pair.start("master", tmp_path, peer="")
    assert link.end() == WRONG_ARGUMENTS
    assert link.lines == ["link: peer = '': must be HOST or HOST:PORT of the other host"]


def udp_keys(folder: Path, *names: str) -> list[str]:
    """Make a folder of keys for each name, all with one key."""
    folders = [folder / name for name in names]
    for each in folders:
        each.mkdir()
    write_new_key(*folders)
    return [str(each) for each in folders]


def test_a_third_that_has_no_key_gets_no_answer_and_stops_nothing(
    pair: Pair, tmp_path: Path
) -> None:
    peer = free_ports()
    port = int(peer.rpartition(":")[2])
    for side, keys in zip(SIDES, udp_keys(tmp_path, *SIDES), strict=True):
        pair.start(side, tmp_path, peer=peer, keys=keys)
    pair.meets()
    known = Authenticator(read_key(str(tmp_path / "master")), "master")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as third:
        third.settimeout(0.0)
        for ahead, link in enumerate((pair.links["master"], pair.links["slave"])):
            own = known.tagged(b"from the master to the slave")  # reflected to the master
            hostile = [own[:-1] + bytes([own[-1] ^ 1]), own[1:], b"", b"hapt", bytes(2000)]
            hostile += [own] * (ahead == 0)
            until = time.monotonic() + 1.5
            while time.monotonic() < until:  # more than a real-time process may take at once
                for data in hostile:
                    third.sendto(data, (PEER, port + ahead))
            link.wait_for(r"datagrams from 127\.0\.0\.1 do not have this link's key")
        with pytest.raises(BlockingIOError):
            third.recv(1)
    assert pair.received() <= set(pair.sent.values())  # the last of them were still under way
    pair.meets()
    assert [link.text.count("do not have") for link in pair.links.values()] == [1, 1]


@pytest.mark.parametrize(("side", "has"), [("master", "none"), ("slave", "another")])
def test_a_host_without_the_key_is_told_so_on_both_and_nothing_passes(
    pair: Pair, tmp_path: Path, side: str, has: str
) -> None:
    (other,) = set(SIDES) - {side}
    (keys,), (others,) = (udp_keys(tmp_path, name) for name in ("keys", "others"))
    peer = free_ports()
    pair.start(side, tmp_path, peer=peer, keys=keys)
    if has == "none":
        pair.start(other, tmp_path, peer=peer, insecure=True)
        pair.links[other].wait_for("insecure:=true: datagrams are not authenticated")
    else:
        pair.start(other, tmp_path, peer=peer, keys=others)

    def told() -> bool:
        for end in pair.ends.values():
            end.send(b"not to be passed")
        return all("do not have this link's key" in link.text for link in pair.links.values())

    wait_until(told, "a line on both hosts")
    assert f"here keys:={keys}" in pair.links[side].text
    own = "this host has none" if has == "none" else f"here keys:={others}"
    assert own in pair.links[other].text
    ends = pair.ends.values()

    def noted() -> bool:
        return not [each.drain() for each in ends if "do not have" not in each.note]

    wait_until(noted, "a note for each coupler")
    assert not pair.received()


@pytest.fixture
def keys(tmp_path: Path) -> Callable[[str, str], dict[str, Path]]:
    """Make the folders of a pair by name: ``keys(NAME, HOST)``; skip without the libraries."""
    pytest.importorskip("zenoh")
    certificates = pytest.importorskip("haptic_accel.kits.link.certificates")

    def made(name: str, host: str = PEER) -> dict[str, Path]:
        (tmp_path / name).mkdir()
        folders = {side: tmp_path / name / side for side in ("slave", "master")}
        pair = certificates.certified_pair([[host], [host]])
        for folder, files in zip(folders.values(), pair, strict=True):
            folder.mkdir()
            write_new(folder, files)
        return folders

    return made


ZENOH = {"transport": "zenoh"}


def test_with_certificates_of_one_authority_datagrams_cross(
    pair: Pair, tmp_path: Path, keys: Callable[..., dict[str, Path]]
) -> None:
    peer, folders = free_ports(), keys("pair")
    for side in SIDES:
        pair.start(side, tmp_path, peer=peer, keys=str(folders[side]), **ZENOH)
    pair.meets()
    pair.links["slave"].end(signal.SIGKILL)
    pair.received()  # what has come before must not pass for what the new link brings
    pair.start("slave", tmp_path, peer=peer, keys=str(folders["slave"]), **ZENOH)
    pair.meets()
    assert [link.end(signal.SIGTERM) for link in pair.links.values()] == [DONE, DONE]


def test_what_is_not_of_the_pair_is_refused_in_one_line_and_nothing_passes(
    pairs: Callable[[], Pair], tmp_path: Path, keys: Callable[..., dict[str, Path]]
) -> None:
    own, other = keys("own"), keys("other")
    (other["master"] / AUTHORITY).write_bytes((own["master"] / AUTHORITY).read_bytes())
    named = keys("named", "10.9.9.9")
    given = (own["slave"], other["master"]), (named["slave"], named["master"])
    both = [pairs() for _ in given]  # at once, as either waits for seconds
    for pair, (slave_keys, master_keys) in zip(both, given, strict=True):
        peer = free_ports()
        slave = pair.start("slave", slave_keys.parent, peer=peer, keys=str(slave_keys), **ZENOH)
        slave.wait_for("the peer connects to port")
        pair.start("master", master_keys.parent, peer=peer, keys=str(master_keys), **ZENOH)
    for pair in both:
        for link in pair.links.values():
            assert "haptic-accel keys" in link.wait_for("connection refused")
            for end in pair.ends.values():
                end.send(b"not to be passed")
            link.wait_for("nothing received for 5 s")
            assert len(link.lines) < 10
        assert not pair.received()


def test_a_client_without_a_certificate_is_refused(
    pair: Pair, tmp_path: Path, keys: Callable[..., dict[str, Path]]
) -> None:
    import zenoh

    peer, folders = free_ports(), keys("pair")
    slave = pair.start("slave", tmp_path, peer=peer, keys=str(folders["slave"]), **ZENOH)
    slave.wait_for("the peer connects to port")
    config = zenoh.Config()
    for name, value in {
        "mode": "client",
        "connect/endpoints": [f"quic/{peer}?mixed_rel=1"],
        "scouting/multicast/enabled": False,
        "transport/link/tls": {"root_ca_certificate": str(folders["slave"] / AUTHORITY)},
    }.items():
        config.insert_json5(name, json.dumps(value))

    def refused() -> bool:
        with pytest.raises(zenoh.ZError):
            zenoh.open(config)
        return "peer sent no certificates" in slave.text

    wait_until(refused, "a line about the client without a certificate")


def test_a_link_waits_for_a_way_to_the_peer_and_says_once_why(pair: Pair, tmp_path: Path) -> None:
    link = pair.start("master", tmp_path, peer="no-such.invalid", insecure=True)
    link.wait_for("peer no-such.invalid: cannot be reached: .*; trying again")
    with pytest.raises(subprocess.TimeoutExpired):
        link.process.wait(1.5 * SEARCH_PERIOD)
    assert link.end(signal.SIGINT) == DONE
    assert len(link.lines) == 1


def test_the_peer_is_reported_once_when_it_is_heard_and_once_when_it_is_not() -> None:
    hearing = PeerMonitor("peer robot", "check it", "", 0.0)
    assert hearing.lines(SILENCE - 0.1) == []
    assert hearing.lines(SILENCE) == ["peer robot: nothing received for 5 s; check it"]
    assert hearing.lines(3 * SILENCE) == []
    hearing.received += 1
    assert hearing.lines(20.0) == ["peer robot is heard"]
    hearing.received += 1
    assert hearing.lines(24.0) == []
    assert hearing.lines(28.9) == []
    assert hearing.lines(29.0)[0].startswith("peer robot: nothing received")


def test_advice_names_addresses_ports_side_and_transport() -> None:
    text = advice(Route("robot", "10.0.0.1", "10.0.0.2", 7300, 7301), "master", "udp")
    for word in ("10.0.0.1", "10.0.0.2", "7300/udp", "7301/udp", "side:=slave", "transport:=udp"):
        assert word in text
    assert "\n" not in text


def test_strangers_get_one_line_a_minute_however_many_they_are() -> None:
    hearing = PeerMonitor("peer robot", "check it", "mine", 0.0)
    said = []
    for tick in range(round(2.5 * REPEAT)):
        hearing.received += 1
        for number in range(100):
            hearing.refuse(f"10.0.0.{number}")
        said += [line for line in hearing.lines(float(tick)) if "heard" not in line]
        assert hearing.problem
    assert len(said) == 3
    assert said[0] == (
        "datagrams from 10.0.0.99 do not have this link's key: both hosts need folders of one"
        " haptic-accel keys, here keys:=mine; 100 refused"
    )
    assert said[1].endswith("; 6100 refused")
    hearing.lines(2.5 * REPEAT + SILENCE)
    assert hearing.problem == ""
