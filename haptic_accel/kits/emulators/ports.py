# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Ports of emulators: pseudo-terminals with names like a USB port's, and faults to inject in them.

The loop for emulators waits for the bytes of all ports.
"""

from __future__ import annotations

import math
import os
import random
import select
import tty
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import Protocol

from haptic_accel import ParameterError
from haptic_accel.core.parameters import read_decimal

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


DROP, GARBAGE, UNPLUG, STALL = "drop", "garbage", "unplug", "stall"
AXIS_ERROR, HEARTBEAT, ESTIMATES, BUS_OFF = "error", "heartbeat", "estimates", "bus_off"

SHARE = 0.05
"""Fraction of the frames affected by `DROP` and `GARBAGE`."""


@dataclass(frozen=True)
class FaultKind:
    """Kind of fault.

    Attributes
    ----------
    text : str
        Description for users.
    rate : float
        Occurrences per second if no time is specified; 0 for a permanent fault.
    duration : float
        Duration of an occurrence, s.
    """

    text: str
    rate: float = 0.0
    duration: float = 0.0


SERIAL_FAULTS = {
    GARBAGE: FaultKind("random bytes are added to one frame in twenty"),
    DROP: FaultKind("bytes of one frame in twenty are lost"),
    STALL: FaultKind("nothing passes for a while, then all of it", rate=0.5, duration=0.05),
    UNPLUG: FaultKind("the port is gone, and the board without power", rate=0.1, duration=1.0),
}
"""Faults of a board on a serial line."""

CAN_FAULTS = {
    DROP: FaultKind("one frame in twenty is lost"),
    GARBAGE: FaultKind("random data is sent with one frame in twenty"),
    AXIS_ERROR: FaultKind("an axis has an error until it is cleared"),
    HEARTBEAT: FaultKind("an axis sends no heartbeats"),
    ESTIMATES: FaultKind("an axis sends no estimates"),
    BUS_OFF: FaultKind("no frame passes, but the adapter is there"),
    UNPLUG: FaultKind("the adapter is gone"),
}
"""Faults of an arm on a CAN bus."""


class Faults:
    """Faults of one port, planned or injected at run time.

    Parameters
    ----------
    text : str
        Faults in the user's form, for example ``drop,error@3,unplug@8``: names separated by
        commas, with or without a time in s after the start.
    kinds : mapping
        Possible faults, by name.
    seconds : float
        Duration of a fault with a specified time, s.
    seed : int

    Attributes
    ----------
    random : Random
        Random source for damaged data.

    Raises
    ------
    ParameterError
        A fault is unknown, or its time is not a number.
    """

    def __init__(
        self,
        text: str = "",
        kinds: Mapping[str, FaultKind] | None = None,
        seconds: float = 1.0,
        seed: int = 0,
    ) -> None:
        self.random = random.Random(seed)
        self._kinds = kinds or {}
        self._planned = list(_read(text, self._kinds))
        self._seconds = seconds
        self._ends: dict[str, float] = {}
        self._beginning = math.inf
        self._now = 0.0

    @property
    def begun(self) -> bool:
        """True once the clock of planned faults runs."""
        return self._beginning < math.inf

    def begin(self) -> None:
        """Start the clock of planned faults, unless it runs already."""
        self._beginning = min(self._beginning, self._now)

    def inject(self, name: str, seconds: float = math.inf) -> None:
        """Activate a fault for a time in s."""
        self._ends[name] = self._now + seconds

    def active(self, name: str) -> bool:
        """Return True while a fault is active."""
        return self._now < self._ends.get(name, -math.inf)

    def strikes(self, name: str) -> bool:
        """Return True if a fault affects the next frame."""
        return self.active(name) and self.random.random() < SHARE

    def advance(self, now: float) -> list[str]:
        """Start and end faults at a time in s; return the names of starting faults."""
        elapsed, self._now = now - self._now, now
        begun = []
        for planned in list(self._planned):
            name, begin = planned
            kind = self._kinds[name]
            if begin is None and kind.rate:
                if self.begun and self.random.random() < kind.rate * elapsed:
                    self.inject(name, kind.duration)
            elif begin is None or now - self._beginning >= begin:
                self._planned.remove(planned)
                self.inject(name, math.inf if begin is None else self._seconds)
                begun.append(name)
        return begun


def _read(text: str, kinds: Mapping[str, FaultKind]) -> Iterator[tuple[str, float | None]]:
    """Parse faults and their times; a time is None if not specified."""
    for word in text.split(",") if text else []:
        name, at, when = word.strip().partition("@")
        try:
            begin = read_decimal(when) if at else 0.0
        except ValueError:
            begin = math.nan
        if name not in kinds or not 0 <= begin < math.inf:
            names = ", ".join(kinds)
            raise ParameterError(f"faults: {word!r}: must be NAME or NAME@SECONDS of {names}")
        yield name, begin if at else None
