# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ports that a host can open, and that can be unplugged."""

from __future__ import annotations

import os
import select
from pathlib import Path

from haptic_accel.kits.emulators.pseudo_terminal import PseudoTerminal


def test_bytes_pass_both_ways_while_a_host_has_it_open(tmp_path: Path) -> None:
    path = tmp_path / "port"
    port = PseudoTerminal(path)
    assert port.plugged
    host = os.open(path, os.O_RDWR | os.O_NOCTTY)
    os.write(host, b"to\0the\nboard\r")
    assert select.select([port], [], [], 10.0)[0]  # the kernel passes bytes on in its own time
    assert port.read() == b"to\0the\nboard\r"
    assert port.read() == b""
    assert port.write(b"to\0the\nhost\r")
    assert os.read(host, 100) == b"to\0the\nhost\r"
    os.close(host)
    assert port.read() is None
    port.unplug()


def test_nothing_is_torn_while_there_is_no_room(tmp_path: Path) -> None:
    port = PseudoTerminal(tmp_path / "port")
    host = os.open(tmp_path / "port", os.O_RDWR | os.O_NOCTTY)
    line = b"0123456789abcdef" * 8
    sent = 0
    while port.write(line):
        sent += 1
    received = b""
    while len(received) < sent * len(line):
        received += os.read(host, 4096)
        port.write(b"")  # sends the rest of the last line
    assert received == line * sent
    os.close(host)
    port.unplug()


def test_it_can_be_unplugged_and_plugged_in_again(tmp_path: Path) -> None:
    path = tmp_path / "port"
    port = PseudoTerminal(path)
    port.unplug()
    port.unplug()
    assert not path.is_symlink()
    assert port.read() is None
    assert not port.write(b"x")
    port.plug()
    name = os.readlink(path)
    port.plug()
    assert os.readlink(path) == name
    port.unplug()
