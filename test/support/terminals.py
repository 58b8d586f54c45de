# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Terminals of programs that read keys."""

from __future__ import annotations

import codecs
import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path
from typing import Any

from running import PATIENCE


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
        # A character of several bytes may come in two parts.
        self._decoder = codecs.getincrementaldecoder("utf-8")()

    @property
    def settings(self) -> list[Any]:
        return termios.tcgetattr(self._own)

    def press(self, keys: bytes) -> None:
        os.write(self._keyboard, keys)

    def wait_for(self, words: str, count: int = 1) -> None:
        deadline = time.monotonic() + PATIENCE
        while self.text.count(words) < count:
            ended = self.process.poll() is not None
            if select.select([self._keyboard], [], [], 0.1)[0]:
                self.text += self._decoder.decode(os.read(self._keyboard, 65536))
            else:
                assert not ended, f"ended without {words!r}: {self.text}"
                assert time.monotonic() < deadline, f"still without {words!r}: {self.text}"

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
