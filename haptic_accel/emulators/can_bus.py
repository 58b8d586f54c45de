"""Emulated arms in real time, on a bus of python-can or as slcan adapters on pseudo-terminals."""

from __future__ import annotations

import os
import random
import tty
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Protocol, TypeAlias

from haptic_accel.devices.can.bus import frame_of, message_of
from haptic_accel.devices.can.protocol import HIGHEST_ID, Command, Frame
from haptic_accel.emulators.can_arm import EmulatedArm
from haptic_accel.emulators.can_faults import (
    AXIS_ERROR,
    BUS_OFF,
    DROP,
    ESTIMATES,
    GARBAGE,
    HEARTBEAT,
    SHARE,
    UNPLUG,
    Faults,
)
from haptic_accel.emulators.slcan import SlcanAdapter, frame_line

if TYPE_CHECKING:
    import can

CHUNK = 4096
"""Bytes read at once."""

Passing: TypeAlias = Callable[[list[Frame]], list[Frame]]
"""Which of some frames arrive."""

MUTED = {HEARTBEAT: Command.HEARTBEAT, ESTIMATES: Command.ENCODER_ESTIMATES}
"""What an axis does not send, by fault."""


class Port(Protocol):
    """Where frames of emulated arms come from and go to."""

    def receive(self) -> list[Frame]:
        """Return what has come; never waits."""

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames; what nobody takes is lost."""

    def babble(self, noise: random.Random) -> None:
        """Send what is no frame, or none of an arm."""

    def unplug(self) -> None:
        """Go away; nothing if already gone."""

    def plug(self) -> None:
        """Come back; nothing if there."""

    def close(self) -> None:
        """Leave nothing behind."""


class SlcanPort:
    """A serial adapter with slcan that is a pseudo-terminal.

    Parameters
    ----------
    path : Path
        Where a symbolic link to it is put.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._master: int | None = None
        self._slave: int | None = None
        self._unsent = b""
        self.plug()

    def receive(self) -> list[Frame]:
        """Return what the computer sent."""
        if self._master is None:
            return []
        try:
            data = os.read(self._master, CHUNK)
        except BlockingIOError:
            return []
        frames, answer = self._adapter.take(data)
        self._write(answer)
        return frames

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames, if the computer has opened the bus."""
        if self._adapter.opened:
            self._write(b"".join(frame_line(frame) for frame in frames))

    def babble(self, noise: random.Random) -> None:
        """Send bytes."""
        self._write(noise.randbytes(noise.randrange(1, 30)) + b"\r")

    def unplug(self) -> None:
        """Hang up."""
        for descriptor in (self._master, self._slave):
            if descriptor is not None:
                os.close(descriptor)
        self._master = self._slave = None
        self._path.unlink(missing_ok=True)

    def plug(self) -> None:
        """Be there, under the same name."""
        if self._master is not None:
            return
        # The other end is kept open here too: else this one fails while nobody has it open.
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self._adapter = SlcanAdapter()
        self._unsent = b""
        self._path.unlink(missing_ok=True)
        self._path.symlink_to(os.ttyname(self._slave))

    def close(self) -> None:
        """Hang up."""
        self.unplug()

    def _write(self, data: bytes) -> None:
        """Write whole lines, or none while there is no room."""
        if self._master is None:
            return
        data = self._unsent or data
        with suppress(BlockingIOError):
            written = os.write(self._master, data)
            self._unsent = data[written:]


class BusPort:
    """A bus of python-can.

    Parameters
    ----------
    open_bus : callable
        Opens it.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = open_bus()

    def receive(self) -> list[Frame]:
        """Return what came."""
        frames: list[Frame] = []
        while self._bus is not None:
            message = self._bus.recv(0.0)
            if message is None:
                break
            frame = frame_of(message)
            frames += [frame] if frame else []
        return frames

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames."""
        import can

        if self._bus is None:
            return
        for frame in frames:
            with suppress(can.CanError):
                self._bus.send(message_of(frame))

    def babble(self, noise: random.Random) -> None:
        """Send a frame of nobody's making."""
        data = noise.randbytes(noise.randrange(9))
        self.send([Frame(noise.randrange(HIGHEST_ID + 1), data)])

    def unplug(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None

    def plug(self) -> None:
        """Be on the bus."""
        self._bus = self._bus or self._open_bus()

    def close(self) -> None:
        """Leave the bus."""
        self.unplug()


class Emulator:
    """Arms at their ports, and what goes wrong at one of them.

    Parameters
    ----------
    lines : sequence of (Port, sequence of EmulatedArm)
        What is where.
    faults : Faults
        By their times from the first torque on.
    faulty : EmulatedArm, optional
        The arm whose port and axes have them.
    seed : int
        Of what is lost and garbled.
    """

    def __init__(
        self,
        lines: Sequence[tuple[Port, Sequence[EmulatedArm]]],
        faults: Faults,
        faulty: EmulatedArm | None = None,
        seed: int = 0,
    ) -> None:
        self._lines = lines
        self._faults = faults
        self._faulty = faulty
        self._random = random.Random(seed)
        self._driven_since: float | None = None
        self._before = 0.0

    @property
    def driven(self) -> bool:
        """Whether any arm has had a torque."""
        return self._driven_since is not None

    def step(self, now: float) -> None:
        """Let everything go on until a time, s."""
        arms = [arm for _, arms in self._lines for arm in arms]
        if self._driven_since is None and any(arm.driven for arm in arms):
            self._driven_since = now
        time = now - self._driven_since if self._driven_since is not None else 0.0
        for port, on_it in self._lines:
            if self._faulty is not None and self._faulty in on_it:
                self._spoil(port, self._faulty, time)
                self._exchange(port, on_it, now, lambda frames: self._passed(frames, time))
            else:
                self._exchange(port, on_it, now, lambda frames: frames)
        self._before = time

    def run(self, rate: float, stop: Callable[[], bool]) -> None:
        """Go on in real time, so many steps a second, until told to stop."""
        due = monotonic()
        while not stop():
            self.step(monotonic())
            now = monotonic()
            due = max(due + 1 / rate, now)
            sleep(due - now)

    def close(self) -> None:
        """Leave nothing behind."""
        for port, _ in self._lines:
            port.close()

    def _exchange(
        self, port: Port, arms: Sequence[EmulatedArm], now: float, passed: Passing
    ) -> None:
        """Pass frames between a port and its arms, as far as they pass."""
        for frame in passed(port.receive()):
            for arm in arms:
                port.send(passed(arm.take(frame, now)))
        for arm in arms:
            port.send(passed(arm.due(now)))

    def _passed(self, frames: list[Frame], time: float) -> list[Frame]:
        if self._faults.active(BUS_OFF, time):
            return []
        if self._faults.active(DROP, time):
            return [frame for frame in frames if self._random.random() > SHARE]
        return frames

    def _spoil(self, port: Port, arm: EmulatedArm, time: float) -> None:
        """Bring faults about that are not in the passing of frames."""
        if self._faults.active(UNPLUG, time):
            port.unplug()
        else:
            port.plug()
        if self._faults.active(GARBAGE, time) and self._random.random() < SHARE:
            port.babble(self._random)
        if self._faults.begins(AXIS_ERROR, time, self._before):
            arm.fail()
        for name, command in MUTED.items():
            mute = arm.axes[0].mute
            (mute.add if self._faults.active(name, time) else mute.discard)(command)
