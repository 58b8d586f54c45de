# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The emulated network of two hosts, as a user runs it."""

from __future__ import annotations

import os
import pty
import signal
import socket
import subprocess
from contextlib import closing

import pytest

from haptic_accel.core.process import module_command
from running import PATIENCE, Start, free_ports
from verbs import refusal

EMULATE = ("emulate", "network")


@pytest.mark.quiet
def test_datagrams_go_from_one_side_to_the_other(haptic_accel: Start) -> None:
    peers = free_ports(), free_ports()
    first, third = (int(peer.rpartition(":")[2]) for peer in peers)
    command = haptic_accel(*EMULATE, f"master:={peers[0]}", f"slave:={peers[1]}")
    command.wait_for("network: delay:=0.0")
    with closing(_at(first)) as master, closing(_at(third + 1)) as slave:
        master.sendto(b"to the slave", ("127.0.0.1", first + 1))
        assert slave.recv(100) == b"to the slave"
        slave.sendto(b"to the master", ("127.0.0.1", third))
        assert master.recv(100) == b"to the master"
    assert command.end(signal.SIGINT) == 0
    assert f"haptic-accel teleop side:=slave peer:={peers[1]}" in command.text


def _at(port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", port))
    opened.settimeout(PATIENCE)
    return opened


@pytest.mark.quiet
def test_words_typed_in_its_terminal_change_the_network() -> None:
    ours, terminal = pty.openpty()
    process = subprocess.Popen(
        [
            *(*module_command("haptic_accel.cli.main"), *EMULATE),
            *(f"master:={free_ports()}", f"slave:={free_ports()}"),
        ],
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        preexec_fn=lambda: os.close(os.open(os.ttyname(0), os.O_RDWR)),  # now its terminal
    )
    assert process.stdout
    with process, open(ours, "wb", buffering=0) as keys:
        os.close(terminal)
        lines = iter(process.stdout.readline, "")
        assert any(line.startswith("network: ") for line in lines)
        keys.write(b"delay:=0.05\n")
        assert next(lines) == "network: delay:=0.05 jitter:=0.0 loss:=0.0 duplication:=0.0\n"
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_ports_of_both_sides_must_not_overlap() -> None:
    host, _, port = free_ports().partition(":")
    same = f"port {int(port) + 1}/udp of {host}: address already in use"
    words = (f"master:={host}:{port}", f"slave:={host}:{int(port) + 1}")
    assert same in refusal(*EMULATE, *words)


def test_a_wrong_network_is_refused_in_one_line() -> None:
    assert "delay = -1.0: must be from 0 to 10 s" in refusal(*EMULATE, "delay:=-1")
