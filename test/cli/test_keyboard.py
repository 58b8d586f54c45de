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

"""The key that stops a graph, pressed in a real terminal."""

from __future__ import annotations

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.topics import COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED
from observing import Observer
from running import PATIENCE, nodes_of

KEYS = """
import sys, time
from haptic_accel.cli.keyboard import on_key
from haptic_accel.cli.running import stop_on_signal
with stop_on_signal() as stop, on_key(b" ", lambda: print("pressed", flush=True)) as read:
    print("reading" if read else "not reading", flush=True)
    while not stop():
        time.sleep(0.02)  # pause() would miss a signal that comes before it
    if "fail" in sys.argv:
        raise RuntimeError("failed")
print("ended", flush=True)
"""


class Terminal:
    """A terminal of which a program is the foreground."""

    def __init__(self, words: list[str], folder: Path) -> None:
        self._keyboard, self._own = pty.openpty()
        self._closed = False
        self.before = termios.tcgetattr(self._own)
        self.process = subprocess.Popen(
            [sys.executable, *words],
            cwd=folder,
            stdin=self._own,
            stdout=self._own,
            stderr=self._own,
            start_new_session=True,
            preexec_fn=_prepare,
        )
        self.text = ""

    @property
    def settings(self) -> list[Any]:
        return termios.tcgetattr(self._own)

    def press(self, keys: bytes) -> None:
        os.write(self._keyboard, keys)

    def wait_for(self, words: str, count: int = 1) -> None:
        deadline = time.monotonic() + PATIENCE
        while self.text.count(words) < count:
            left = deadline - time.monotonic()
            assert left > 0, self.text
            if select.select([self._keyboard], [], [], left)[0]:
                self.text += os.read(self._keyboard, 65536).decode()

    def hang_up(self) -> None:
        os.close(self._keyboard)
        os.close(self._own)
        self._closed = True

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        if not self._closed:
            self.hang_up()


def _prepare() -> None:
    """Make the terminal the process's own; nohup would have it ignore the terminal's end."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


@pytest.fixture
def terminals(tmp_path: Path) -> Iterator[Any]:
    opened: list[Terminal] = []

    def opening(*words: str) -> Terminal:
        opened.append(Terminal(list(words), tmp_path))
        return opened[-1]

    yield opening
    for terminal in opened:
        terminal.close()


@pytest.mark.parametrize("end", [b"\x03", b"\x1c", signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("fail", [True, False])
def test_a_key_acts_without_enter_and_the_terminal_is_restored(
    terminals: Any, end: bytes | signal.Signals, fail: bool
) -> None:
    terminal = terminals("-c", KEYS, *(["fail"] if fail else []))
    terminal.wait_for("reading")
    terminal.press(b"x \n ")
    terminal.wait_for("pressed")
    terminal.press(b" ")
    terminal.wait_for("pressed", 2)
    assert terminal.settings != terminal.before
    if isinstance(end, bytes):
        terminal.press(end)
    else:
        terminal.process.send_signal(end)
    terminal.wait_for("failed" if fail else "ended")
    terminal.process.wait(PATIENCE)
    assert terminal.settings == terminal.before


def test_what_is_no_terminal_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "input").write_text("  ")
    with (tmp_path / "input").open() as given:
        command = subprocess.Popen(
            [sys.executable, "-c", KEYS], stdin=given, stdout=subprocess.PIPE, text=True
        )
        assert command.stdout
        assert command.stdout.readline() == "not reading\n"
        command.send_signal(signal.SIGTERM)
        assert command.stdout.read() == "ended\n"
        command.wait(PATIENCE)
        command.stdout.close()
        assert given.read() == "  "


def test_the_space_key_stops_a_graph_and_does_not_release_it(
    terminals: Any, observer: Observer
) -> None:
    terminal = terminals("-m", "haptic_accel.cli.main", "teleop", "record:=false")
    terminal.wait_for("engaged")
    for times in (1, 2):
        terminal.press(b" ")
        terminal.wait_for("space: emergency stop", times)
        for topic in (COUPLER_STOPPED, MASTER_STOPPED, SLAVE_STOPPED):
            observer.wait_for_state(topic, True)
    terminal.wait_for("emergency stop: no force until it is released", 2)
    assert "released" not in terminal.text.replace("until it is released", "")
    terminal.press(b"\x03")
    assert terminal.process.wait(PATIENCE) == 0
    assert terminal.settings == terminal.before


def test_a_terminal_that_hangs_up_ends_the_graph_in_order(
    terminals: Any, domain: int, tmp_path: Path
) -> None:
    terminal = terminals("-m", "haptic_accel.cli.main", "teleop", "rate:=200", "bag:=bag")
    terminal.wait_for("engaged")
    terminal.hang_up()
    assert terminal.process.wait(PATIENCE) == 0
    assert nodes_of(domain) == {}
    assert read_bag(tmp_path / "bag").problems == []
