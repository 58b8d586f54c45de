"""Emulated boards in real time, behind real pseudo-terminals."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from haptic_accel.devices.serial.protocol import Identity
from haptic_accel.emulators.serial_line import EmulatedBoard

HANDLE = Identity((1, 2, 3), 0b100, 5000, 49.0, 2.75, "handle-1")


class Bench:
    """A board that samples what it is told, on a thread of its own.

    Attributes
    ----------
    emulated : EmulatedBoard
    acceleration : float
        That its accelerometer feels, m/s^2.
    """

    def __init__(self, link: Path, identity: Identity) -> None:
        self.emulated = EmulatedBoard(identity, link)
        self.path = str(link)
        self.acceleration = 0.0
        self._wishes: queue.Queue[Callable[[float], None]] = queue.Queue()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def suffer(self, fault: str, seconds: float | None = None) -> None:
        """Let something be wrong from now on."""
        self._wishes.put(lambda now: self.emulated.suffer(fault, now, seconds))

    def end(self) -> None:
        """Pull it out for good."""
        self._ending.set()
        self._thread.join()
        self.emulated.close()

    def _run(self) -> None:
        taken = time.monotonic()
        while not self._ending.wait(0.0005):
            now = time.monotonic()
            while not self._wishes.empty():
                self._wishes.get()(now)
            self.emulated.look(now)
            period = 1 / self.emulated.rate if self.emulated.rate else 0.0
            while period and taken + period <= now:
                taken += period
                self.emulated.sample(self.acceleration, taken)
            taken = taken if period else now


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    """Make boards that end with the test."""
    made: list[Bench] = []

    def make(identity: Identity = HANDLE, name: str = "port") -> Bench:
        made.append(Bench(tmp_path / name, identity))
        return made[-1]

    yield make
    for one in made:
        one.end()
