# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated boards in real time, behind real pseudo-terminals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.model import Vector
from haptic_accel.core.parameters import from_flat
from haptic_accel.devices.serial import protocol
from haptic_accel.devices.serial.device import SerialDevice, SerialMaster
from haptic_accel.kits.emulators.ports import run
from haptic_accel.kits.emulators.serial_line import Board, EmulatedBoard, SerialLines
from running import on_thread

HANDLE = protocol.Identity((1, 2, 3), 0b100, 5000, 49.0, (0.0, 0.0, 2.75), "handle-1")


class Bench:
    """A board in a thread of its own.

    Attributes
    ----------
    emulated : EmulatedBoard
    measure : callable
        Returns the acceleration along z at its accelerometer at a time in s, m/s^2.
    driven : list of tuple of float
        Times in s at which a current changed, and the current along z from then on, A.
    """

    def __init__(self, link: Path, identity: protocol.Identity, drift: float) -> None:
        self.measure: Callable[[float], float] = lambda time: 0.0
        across = 1.0, 2.0
        self.driven: list[tuple[float, float]] = []
        self.emulated = EmulatedBoard(
            identity, link, lambda time: (*across, self.measure(time)), self._note, drift=drift
        )
        self.path = str(link)
        self._stack = ExitStack()
        self._stack.callback(self.emulated.close)
        self._stack.enter_context(on_thread(partial(run, [SerialLines([self.emulated])])))

    def _note(self, time: float, currents: Vector) -> None:
        self.driven.append((time, currents[2]))

    @property
    def current(self) -> float:
        """Current along z, A."""
        return self.emulated.currents[2]

    def hold(self, acceleration: float) -> None:
        """Let the accelerometer measure the same from now on, m/s^2."""
        self.measure = lambda time: acceleration

    def inject(self, fault: str, seconds: float) -> None:
        """Inject a fault for a time from now on."""
        self.emulated.faults.inject(fault, seconds)

    def end(self) -> None:
        """Unplug it for good."""
        self._stack.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Callable[..., Bench]]:
    """Make boards that end with the test."""
    made: list[Bench] = []

    def make(
        identity: protocol.Identity = HANDLE, name: str = "port", drift: float = 0.0
    ) -> Bench:
        made.append(Bench(tmp_path / name, identity, drift))
        return made[-1]

    yield make
    for one in made:
        one.end()


class OlderBoard(Board):
    """A board that speaks protocol 2, and refuses a frame of protocol 3 as its firmware does."""

    def __init__(self, identity: protocol.Identity, send: Callable[[bytes], bool]) -> None:
        super().__init__(identity, lambda wire: send(self._older(wire)))
        self._heard = protocol.Decoder()

    def receive(self, data: bytes, now: int) -> None:
        for frame in self._heard.feed(data):
            # The refusal of a version is the same in both.
            version = protocol.VERSION if frame.version == protocol.ONE_COIL else protocol.ONE_COIL
            super().receive(protocol.encode(frame._replace(version=version)), now)

    def _older(self, wire: bytes) -> bytes:
        (frame,) = protocol.Decoder().feed(wire)
        payload = frame.payload
        if frame.type == protocol.FrameType.IDENTITY:
            payload = payload[:10] + payload[18:]  # the current of the coil along z only
        return protocol.encode(frame._replace(version=protocol.ONE_COIL, payload=payload))


@pytest.fixture
def older(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let boards speak protocol 2."""
    monkeypatch.setattr("haptic_accel.kits.emulators.serial_line.Board", OlderBoard)


Make = Callable[..., SerialDevice]


@pytest.fixture
def built(request: pytest.FixtureRequest) -> Make:
    """Build devices for 1 kHz; `DEFAULTS` of the test's module are their parameters."""
    defaults = getattr(request.module, "DEFAULTS", {})

    def make(kind: type[SerialDevice] = SerialMaster, **values: Any) -> SerialDevice:
        given = {name.replace("__", "."): value for name, value in {**defaults, **values}.items()}
        return kind(from_flat(kind.Parameters, given), 1000.0, 0)

    return make


@pytest.fixture
def connect(built: Make) -> Iterator[Make]:
    """Open devices that are closed with the test."""
    with ExitStack() as opened:

        def make(
            board: Any, kind: type[SerialDevice] = SerialMaster, **values: Any
        ) -> SerialDevice:
            device = built(kind, port=board.path, **values)
            opened.callback(device.close)
            device.open()
            return device

        yield make
