# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Certificates, checked by TLS connections in memory."""

from __future__ import annotations

import ssl
from pathlib import Path

import pytest

from haptic_accel.core.parameters import ParameterError
from haptic_accel.kits.link.datagrams import write_new
from haptic_accel.kits.link.zenoh import AUTHORITY, CERTIFICATE, KEY

certificates = pytest.importorskip("haptic_accel.kits.link.certificates")

HOSTS = [["robot.lab", "10.8.0.2", "fd00::2"], ["127.0.0.1"]]


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    made = []
    for pair in ("one", "two"):
        folder = tmp_path_factory.mktemp(pair)
        for name, files in zip("ab", certificates.certified_pair(HOSTS), strict=True):
            (folder / name).mkdir()
            write_new(folder / name, files)
            made.append(folder / name)
    return made


def handshake(server: Path, client: Path, host: str) -> None:
    """Connect with mutual authentication."""
    contexts = []
    for folder, protocol in ((server, ssl.PROTOCOL_TLS_SERVER), (client, ssl.PROTOCOL_TLS_CLIENT)):
        context = ssl.SSLContext(protocol)
        context.load_cert_chain(folder / CERTIFICATE, folder / KEY)
        context.load_verify_locations(folder / AUTHORITY)
        context.verify_mode = ssl.CERT_REQUIRED
        contexts.append(context)
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [
        contexts[1].wrap_bio(to_client, to_server, server_hostname=host),
        contexts[0].wrap_bio(to_server, to_client, server_side=True),
    ]
    for _ in range(4):
        for end in ends:
            try:
                end.do_handshake()
            except ssl.SSLWantReadError:
                continue


@pytest.mark.parametrize("host", HOSTS[0])
def test_the_hosts_of_a_pair_know_each_other_by_each_name(folders: list[Path], host: str) -> None:
    robot, operator, *_ = folders
    handshake(robot, operator, host)
    handshake(operator, robot, "127.0.0.1")


def test_other_names_and_other_pairs_are_refused(folders: list[Path]) -> None:
    robot, operator, other_robot, other_operator = folders
    pairs = (robot, operator, "10.8.0.3"), (robot, other_operator, "robot.lab")
    for server, client, host in (*pairs, (other_robot, operator, "robot.lab")):
        with pytest.raises(ssl.SSLError):
            handshake(server, client, host)


def test_only_the_owner_reads_the_files_and_none_is_written_over(folders: list[Path]) -> None:
    for path in folders[0].iterdir():
        assert path.stat().st_mode & 0o077 == 0
    assert {path.name for path in folders[0].iterdir()} == {AUTHORITY, CERTIFICATE, KEY}
    with pytest.raises(FileExistsError):
        write_new(folders[0], certificates.certified_pair(HOSTS)[0])


@pytest.mark.parametrize("name", ["", "a b", "-a", "*.lab", "r\u00f6bot"])
def test_what_is_no_host_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(ParameterError, match=r"must be the name or address of a host$"):
        certificates.certified_pair([["robot"], [name]])
