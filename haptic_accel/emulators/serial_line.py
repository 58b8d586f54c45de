"""Boards that are none: the firmware's rules behind pseudo-terminals, with faults on demand."""

from __future__ import annotations

import os
import random
import tty
from collections import Counter, deque
from contextlib import suppress
from pathlib import Path

from haptic_accel.devices.serial.protocol import FULL_SCALE, Identity
from haptic_accel.emulators.serial_board import CLOCKS, Board
from haptic_accel.emulators.serial_faults import DROP, GARBAGE, STALL, UNPLUG

STALL_TIME, UNPLUG_TIME = 0.05, 1.0
"""s."""

MOST_GARBAGE = 40
"""Bytes at a time."""

MOST_DROPPED = 8
"""Bytes at a time."""

MOST_HELD = 4096
"""Bytes that a stalled wire keeps, as a driver's buffer does."""

CLOCK_START = CLOCKS - 20_000_000
"""us: a board's clock begins anew 20 s after the start."""


class PseudoPort:
    """A pseudo-terminal with a name of its own, as a USB port has, that can be pulled out."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self._master: int | None = None

    @property
    def plugged(self) -> bool:
        """Whether it is there."""
        return self._master is not None

    def plug(self) -> None:
        """Let it be there."""
        master, terminal = os.openpty()
        tty.setraw(terminal)
        name = os.ttyname(terminal)
        # Closed, so that the master end tells when a host opens and closes it.
        os.close(terminal)
        os.set_blocking(master, False)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(name)
        self._master = master

    def unplug(self) -> None:
        """Pull it out."""
        self.link.unlink(missing_ok=True)
        if self._master is not None:
            os.close(self._master)
        self._master = None

    def fileno(self) -> int:
        """Return what to wait on."""
        assert self._master is not None
        return self._master

    def read(self) -> bytes | None:
        """Return the bytes that are there; None while no host has it open."""
        if self._master is None:
            return None
        try:
            return os.read(self._master, MOST_HELD)
        except BlockingIOError:
            return b""
        except OSError:
            return None

    def write(self, data: bytes) -> bool:
        """Write bytes if there is room; whether there was."""
        if self._master is None:
            return False
        with suppress(OSError):
            return os.write(self._master, data) == len(data)
        return False


class EmulatedBoard:
    """A board on a pseudo-terminal, on a wire that may be bad. Times are s of any clock.

    Parameters
    ----------
    identity : Identity
    link : Path
        Symbolic link to make to the terminal.
    seed : int
        Of the faults.

    Attributes
    ----------
    board : Board
        Of now: pulled out, it loses its power, and with it all it knew.
    open : bool
        Whether a host has the port open.
    gravity : float
        Added to the acceleration along z, m/s^2: how it is held.
    faults : Counter
        How often each happened.
    """

    def __init__(self, identity: Identity, link: Path, seed: int = 0) -> None:
        self._identity = identity
        self._random = random.Random(seed)
        self._port = PseudoPort(link)
        self._due_in: set[str] = set()
        self._due_out: set[str] = set()
        self._held_out: deque[bytes] = deque()
        self._held_in = b""
        self._stalled_until = self._unplugged_until = float("-inf")
        self.board = Board(identity, self._send)
        self.open = False
        self.gravity = 0.0
        self.faults: Counter[str] = Counter()
        self._now = 0.0
        self._port.plug()

    @property
    def port(self) -> PseudoPort | None:
        """What to wait on for bytes of a host; None while there can be none."""
        return self._port if self.open and self._port.plugged else None

    @property
    def current(self) -> float:
        """That flows, A."""
        return self.board.current / FULL_SCALE * self._identity.full_scale_current

    @property
    def rate(self) -> int:
        """Samples per second that the host wants; 0 for none."""
        return self.board.configuration.rate

    def suffer(self, fault: str, now: float, duration: float | None = None) -> None:
        """Let something be wrong from now on.

        Parameters
        ----------
        fault : str
            Of `FAULTS`.
        now : float
            s.
        duration : float, optional
            Of a stall, or of being pulled out, s; of the others only the next bytes suffer, one
            frame or so either way.
        """
        self.faults[fault] += 1
        if fault == STALL:
            self._stalled_until = now + (STALL_TIME if duration is None else duration)
        elif fault == UNPLUG:
            self._unplugged_until = now + (UNPLUG_TIME if duration is None else duration)
            self._pull_out()
        else:
            self._due_in.add(fault)
            self._due_out.add(fault)

    def look(self, now: float) -> None:
        """Take what the host sent, and look at the time."""
        self._now = now
        if not self._port.plugged and now >= self._unplugged_until:
            self._port.plug()
        self._receive(now)
        self.board.tick(clock(now))
        if now >= self._stalled_until:
            self._catch_up()

    def sample(self, acceleration: float, time: float) -> None:
        """Take a sample along z, m/s^2, at its time."""
        share = (acceleration + self.gravity) / self._identity.full_scale_acceleration
        counts = round(min(1.0, max(-1.0, share)) * FULL_SCALE)
        self.board.sample((0, 0, counts), clock(time))

    def close(self) -> None:
        """Pull it out for good."""
        self._port.unplug()

    def _pull_out(self) -> None:
        self._port.unplug()
        self._forget_bytes()
        self.board = Board(self._identity, self._send)
        self.open = False

    def _forget_bytes(self) -> None:
        self._held_out.clear()
        self._held_in = b""
        self._stalled_until = float("-inf")

    def _receive(self, now: float) -> None:
        data = self._port.read()
        if data is None:
            if self.open:
                self.board.disconnect()
                self._forget_bytes()
            self.open = False
            return
        self.open = True
        if now < self._stalled_until:
            self._held_in = (self._held_in + data)[-MOST_HELD:]
        elif data := self._held_in + data:
            self._held_in = b""
            self.board.receive(self._spoil(data, self._due_in), clock(now))

    def _send(self, data: bytes) -> bool:
        if self._now < self._stalled_until or self._held_out:
            room = sum(map(len, self._held_out)) + len(data) <= MOST_HELD
            if room:
                self._held_out.append(data)
            return room
        return self._port.write(self._spoil(data, self._due_out))

    def _catch_up(self) -> None:
        """Let go what a stall held back."""
        while self._held_out and self._port.write(self._held_out[0]):
            self._held_out.popleft()

    def _spoil(self, data: bytes, due: set[str]) -> bytes:
        """Return bytes as a bad wire delivers them, once for each fault that is due."""
        if DROP in due:
            start = self._random.randrange(len(data))
            data = data[:start] + data[start + self._random.randint(1, MOST_DROPPED) :]
        if GARBAGE in due:
            start = self._random.randrange(len(data) + 1)
            garbage = self._random.randbytes(self._random.randint(1, MOST_GARBAGE))
            data = data[:start] + garbage + data[start:]
        due.clear()
        return data


def clock(time: float) -> int:
    """Return what a board's clock shows at a time in s, us."""
    return (CLOCK_START + round(time * 1e6)) % CLOCKS
