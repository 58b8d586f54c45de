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

"""Emulated arms on a bus of python-can, or behind slcan adapters on pseudo-terminals."""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from haptic_accel.devices.can.bus import frame_of, message_of
from haptic_accel.devices.can.protocol import HIGHEST_ID, Command, Frame
from haptic_accel.kits.emulators import faults as fault
from haptic_accel.kits.emulators.can_arm import EmulatedArm
from haptic_accel.kits.emulators.faults import Faults
from haptic_accel.kits.emulators.pseudo_terminal import PseudoTerminal

if TYPE_CHECKING:
    import can
import re

MUTED = {fault.HEARTBEAT: Command.HEARTBEAT, fault.ESTIMATES: Command.ENCODER_ESTIMATES}
"""Command that an axis does not send, by fault."""


class SlcanPort:
    """Serial adapter with slcan, as a pseudo-terminal.

    Parameters
    ----------
    path : Path
        Symbolic link to make to the terminal.
    """

    def __init__(self, path: Path) -> None:
        self._terminal = PseudoTerminal(path)
        self._adapter = SlcanAdapter()

    def receive(self) -> list[Frame]:
        """Return the frames that the host has sent; never waits."""
        frames, answer = self._adapter.receive(self._terminal.read() or b"")
        if answer:
            self._terminal.write(answer)
        return frames

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames, if the host has opened the bus."""
        lines = b"".join(map(frame_line, frames))
        if lines and self._adapter.opened:
            self._terminal.write(lines)

    def send_garbage(self, noise: random.Random) -> None:
        """Send random bytes."""
        self._terminal.write(noise.randbytes(noise.randrange(1, 30)) + b"\r")

    def plug(self) -> None:
        """Create the port, with the bus closed."""
        if not self._terminal.plugged:
            self._adapter = SlcanAdapter()
            self._terminal.plug()

    def unplug(self) -> None:
        """Remove the port."""
        self._terminal.unplug()


class BusPort:
    """Bus of python-can.

    Parameters
    ----------
    open_bus : callable
        Function that opens the bus.
    """

    def __init__(self, open_bus: Callable[[], can.BusABC]) -> None:
        self._open_bus = open_bus
        self._bus: can.BusABC | None = open_bus()

    def receive(self) -> list[Frame]:
        """Return the available frames; never waits."""
        messages = iter(lambda: self._bus.recv(0.0) if self._bus else None, None)
        return [frame for frame in map(frame_of, messages) if frame]

    def send(self, frames: Iterable[Frame]) -> None:
        """Send frames; those that cannot be sent are lost."""
        import can

        if self._bus is None:
            return
        for frame in frames:
            with suppress(can.CanError):
                self._bus.send(message_of(frame))

    def send_garbage(self, noise: random.Random) -> None:
        """Send a random frame."""
        self.send([Frame(noise.randrange(HIGHEST_ID + 1), noise.randbytes(noise.randrange(9)))])

    def plug(self) -> None:
        """Join the bus."""
        self._bus = self._bus or self._open_bus()

    def unplug(self) -> None:
        """Leave the bus."""
        if self._bus is not None:
            self._bus.shutdown()
            self._bus = None


CanPort: TypeAlias = SlcanPort | BusPort
"""Access of emulated arms to a bus."""


class CanLine:
    """Arms at a port, with faults of the port and of one arm; times are s since the start.

    Parameters
    ----------
    port : CanPort
    arms : sequence of EmulatedArm
        Arms; axis faults affect the first axis of the first arm.
    rate : float
        Steps per second.
    faults : Faults
        Faults; their times count from the first torque.

    Attributes
    ----------
    due : float
        Time of the next step.
    """

    terminals = ()

    def __init__(
        self, port: CanPort, arms: Sequence[EmulatedArm], rate: float, faults: Faults
    ) -> None:
        self._port = port
        self._arms = arms
        self._period = 1 / rate
        self._faults = faults
        self.due = 0.0

    @property
    def driven(self) -> bool:
        """True once an arm has had a torque."""
        return self._faults.begun

    def step(self, now: float) -> None:
        """Exchange frames between port and arms."""
        if now < self.due:
            return
        self.due = max(self.due + self._period, now)
        self._inject(now)
        for frame in self._passed(self._port.receive()):
            for arm in self._arms:
                self._port.send(self._passed(arm.receive(frame, now)))
        for arm in self._arms:
            self._port.send(self._passed(arm.due(now)))
        if any(arm.driven for arm in self._arms):
            self._faults.begin()

    def close(self) -> None:
        """Leave the bus."""
        self._port.unplug()

    def _inject(self, now: float) -> None:
        """Inject the faults that do not affect passing frames."""
        faults, faulty = self._faults, self._arms[0]
        if fault.AXIS_ERROR in faults.advance(now):
            faulty.fail()
        mute = faulty.axes[0].mute
        for name, command in MUTED.items():
            (mute.add if faults.active(name) else mute.discard)(command)
        if faults.active(fault.UNPLUG):
            self._port.unplug()
        else:
            self._port.plug()
        if faults.strikes(fault.GARBAGE):
            self._port.send_garbage(faults.random)

    def _passed(self, frames: list[Frame]) -> list[Frame]:
        if self._faults.active(fault.BUS_OFF):
            return []
        return [frame for frame in frames if not self._faults.strikes(fault.DROP)]


END, OK, ERROR = b"\r", b"\r", b"\a"

# slcan: a CAN bus as text lines on a serial port, with the commands of the Lawicel CAN232 manual,
# which slcan adapters support. The other end is python-can's interface `slcan` or Linux' slcand.

LONGEST_LINE = 26
"""Maximum length of a line: T, an extended id of 8, a length and 8 bytes of data."""

ANSWERS = {b"V": b"V1013" + END, b"N": b"NHAPT" + END, b"F": b"F00" + END}
"""Answers to queries, by first letter."""

ACCEPTED = b"OLCSsZMmWXTR"
"""First letters of other commands; frames with extended ids are accepted and ignored."""

FRAME = re.compile(rb"([tr])([0-7][0-9a-fA-F]{2})([0-8])((?:[0-9a-fA-F]{2})*)")
"""Line of a frame: data or request, id, length and data."""


def frame_line(frame: Frame) -> bytes:
    """Return a frame in an adapter's format, with its end."""
    if frame.remote:
        return b"r%03X0\r" % frame.id
    return b"t%03X%d%b\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode())


def parse_frame_line(line: bytes) -> Frame | None:
    """Parse a line, without its end, as a standard-id frame; None if it is no frame."""
    match = FRAME.fullmatch(line)
    if not match:
        return None
    kind, identifier, length, data = match.groups()
    remote = kind == b"r"
    if len(data) != (0 if remote else 2 * int(length)):
        return None
    return Frame(int(identifier, 16), bytes.fromhex(data.decode()), remote)


class SlcanAdapter:
    """Adapter that executes the commands of a host.

    Attributes
    ----------
    opened : bool
        True while the host receives frames.
    """

    def __init__(self) -> None:
        self.opened = False
        self._rest = b""

    def receive(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Process bytes from the host.

        Returns
        -------
        frames : list of Frame
            Frames for the bus.
        answer : bytes
            Answer to the host.
        """
        *lines, rest = (self._rest + data).split(END)
        # Discard a long line without an end.
        self._rest = rest if len(rest) <= LONGEST_LINE else b""
        frames, answers = [], []
        for line in lines:
            frame = parse_frame_line(line)
            if frame is not None and self.opened:
                frames.append(frame)
                answers.append(OK)
                continue
            if line[:1] in (b"O", b"L", b"C"):
                self.opened = line[:1] != b"C"
            accepted = OK if line[:1] in ACCEPTED else ERROR
            answers.append(ANSWERS.get(line[:1], accepted))
        return frames, b"".join(answers)
