# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Pseudo-terminal with a name in the file system, like a USB port; loop for emulators."""

from __future__ import annotations

import os
import select
import tty
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic
from typing import Protocol

BUFFER = 4096
"""Maximum number of bytes read at once: the size of a driver's buffer."""


class PseudoTerminal:
    """Serial port that a host can open, and that can be unplugged.

    Parameters
    ----------
    path : Path
        Symbolic link to make to the terminal.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._master: int | None = None
        self._unsent = b""
        self.plug()

    @property
    def plugged(self) -> bool:
        """True while the port exists."""
        return self._master is not None

    def plug(self) -> None:
        """Create the port, unless it exists."""
        if self.plugged:
            return
        master, terminal = os.openpty()
        tty.setraw(terminal)
        name = os.ttyname(terminal)
        # Close this end, so that reads detect a host that opens or closes the port.
        os.close(terminal)
        os.set_blocking(master, False)
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(name)
        self._master, self._unsent = master, b""

    def unplug(self) -> None:
        """Remove the port, unless it is removed already."""
        self._path.unlink(missing_ok=True)
        if self._master is not None:
            os.close(self._master)
        self._master = None

    def fileno(self) -> int:
        """Return the file descriptor for waiting for bytes."""
        assert self._master is not None
        return self._master

    def read(self) -> bytes | None:
        """Return the available bytes; None while no host has the port open."""
        if self._master is None:
            return None
        try:
            return os.read(self._master, BUFFER)
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> bool:
        """Write bytes; return False without writing any if there is no room."""
        if self._master is None:
            return False
        with suppress(OSError):
            if self._unsent:
                self._unsent = self._unsent[os.write(self._master, self._unsent) :]
            if not self._unsent:
                self._unsent = data[os.write(self._master, data) :]
                return True
        return False


class Part(Protocol):
    """Interface of a part of an emulator; times are in s since its start."""

    due: float
    """Time of the next step."""

    @property
    def terminals(self) -> Sequence[PseudoTerminal]:
        """Ports whose received bytes make a step due at once."""

    def step(self, now: float) -> None:
        """Execute everything due at a time; may also be called earlier."""


def run(parts: Sequence[Part], ended: Callable[[], bool]) -> None:
    """Step all parts whenever a part is due or has bytes, until `ended`."""
    start = monotonic()
    while not ended():
        terminals = [terminal for part in parts for terminal in part.terminals]
        due = min(part.due for part in parts)
        select.select(terminals, [], [], max(0.0, due - (monotonic() - start)))
        now = monotonic() - start
        for part in parts:
            part.step(now)
