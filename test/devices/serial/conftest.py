"""Emulated boards in real time, behind real pseudo-terminals."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from haptic_accel.devices.serial.protocol import Identity
from haptic_accel.emulators.loop import run
from haptic_accel.emulators.serial_line import EmulatedBoard

HANDLE = Identity((1, 2, 3), 0b100, 5000, 49.0, 2.75, "handle-1")


class Bench:
    """A board in a thread of its own.

    Attributes
    ----------
    emulated : EmulatedBoard
    acceleration : float
        Acceleration at its accelerometer, m/s^2.
    """

    def __init__(self, link: Path, identity: Identity) -> None:
        self.acceleration = 0.0
        self.emulated = EmulatedBoard(identity, link, lambda time: self.acceleration)
        self.path = str(link)
        self._ending = threading.Event()
        self._thread = threading.Thread(target=run, args=([self.emulated], self._ending.is_set))
        self._thread.start()

    def inject(self, fault: str, seconds: float) -> None:
        """Inject a fault for a time from now on."""
        self.emulated.faults.inject(fault, seconds)

    def end(self) -> None:
        """Unplug it for good."""
        self._ending.set()
        self._thread.join()
        self.emulated.close()


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
