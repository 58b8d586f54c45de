# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The emulated network of two hosts, as a user runs it."""

from __future__ import annotations

import os
import pty
import signal
import socket
import subprocess
from collections.abc import Callable
from contextlib import closing

import pytest

from haptic_accel.core.process import module_command
from running import PATIENCE, Command
from verbs import refusal

EMULATE = ("emulate", "network", "master:=127.0.0.1:7292", "slave:=127.0.0.1:7294")


@pytest.mark.quiet
def test_datagrams_go_from_one_side_to_the_other(haptic_accel: Callable[..., Command]) -> None:
    command = haptic_accel(*EMULATE)
    command.wait_for("network: delay:=0.0")
    with closing(_at(7292)) as master, closing(_at(7295)) as slave:
        master.sendto(b"to the slave", ("127.0.0.1", 7293))
        assert slave.recv(100) == b"to the slave"
        slave.sendto(b"to the master", ("127.0.0.1", 7294))
        assert master.recv(100) == b"to the master"
    assert command.end(signal.SIGINT) == 0
    assert "haptic-accel teleop side:=slave peer:=127.0.0.1:7294" in command.text


def _at(port: int) -> socket.socket:
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.bind(("127.0.0.1", port))
    opened.settimeout(PATIENCE)
    return opened


@pytest.mark.quiet
def test_words_typed_in_its_terminal_change_the_network() -> None:
    ours, terminal = pty.openpty()
    process = subprocess.Popen(
        [*module_command("haptic_accel.cli.main"), *EMULATE[:2], "master:=127.0.0.1:7282"],
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
        expected = "network: delay:=0.05 jitter:=0.0 loss:=0.0 duplication:=0.0\n"
        assert next(lines) == expected
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0


def test_wrong_arguments_are_refused_in_one_line() -> None:
    assert refusal("emulate", "network", "delay:=-1").startswith("delay = -1.0: must be from 0")
    same = ("master:=127.0.0.1:7290", "slave:=127.0.0.1:7291")
    assert "port 7291/udp of 127.0.0.1: address already in use" in refusal(*EMULATE[:2], *same)
