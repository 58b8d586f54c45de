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

"""Emulated boards on pseudo-terminals, and the coupling of their arms.

Bytes are exchanged when the emulator wakes. Samples and forces are then processed in order, each
with its own time, so that a late wake-up loses none.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import attrgetter
from pathlib import Path

from haptic_accel.core import tick
from haptic_accel.core.actuator.safety import SafetyParameters
from haptic_accel.core.coupling.engagement import Engagement, EngagementParameters
from haptic_accel.core.model import ZERO, Vector
from haptic_accel.core.topics import ARMS
from haptic_accel.devices.serial.protocol import CLOCKS, FULL_SCALE, Identity
from haptic_accel.devices.simulated import SimulatedDevice
from haptic_accel.kits.emulators.faults import DROP, GARBAGE, STALL, UNPLUG, Faults
from haptic_accel.kits.emulators.pseudo_terminal import BUFFER, PseudoTerminal
from haptic_accel.kits.emulators.serial_board import Board

STEP = 1e-3
"""Period of the coupling and of the boards' timeouts, s (paper's servo loop)."""

LONGEST_DELAY = 0.1
"""Delay after which overdue samples and forces are skipped, s."""

MOST_GARBAGE, MOST_DROPPED = 40, 8
"""Maximum number of bytes added and removed at once."""

CLOCK_START = CLOCKS - 20_000_000
"""Start of a board's clock, us: it wraps around 20 s later."""


class EmulatedBoard:
    """Board on a pseudo-terminal, on a line with faults; times are s since the start.

    Parameters
    ----------
    identity : Identity
    path : Path
        Symbolic link to make to the terminal.
    measure : callable
        Function from a time to the acceleration along the sensor's axes, m/s^2.
    drive : callable, optional
        Function called with a time and the coils' currents from then on, A.
    faults : Faults, optional
    drift : float
        Relative error of the clock rate.

    Attributes
    ----------
    board : Board
        State of the firmware; an unplugged board loses its power, and thus its state.
    faults : Faults
    open : bool
        True while a host has the port open.
    due : float
        Time of the next sample; infinite without samples.
    """

    def __init__(
        self,
        identity: Identity,
        path: Path,
        measure: Callable[[float], Vector],
        drive: Callable[[float, Vector], None] | None = None,
        faults: Faults | None = None,
        drift: float = 0.0,
    ) -> None:
        self._identity = identity
        self._port = PseudoTerminal(path)
        self._measure = measure
        self._drive = drive
        self._driven = ZERO
        self._held_out = self._held_in = b""
        self._clock_rate = 1e6 * (1 + drift)
        self.board = Board(identity, self._send)
        self.faults = faults or Faults()
        self.open = False
        self.due = math.inf

    @property
    def terminal(self) -> PseudoTerminal | None:
        """Port to wait for; None while no host has it open."""
        return self._port if self.open and self._port.plugged else None

    @property
    def currents(self) -> Vector:
        """Currents of the coils along x, y and z, A."""
        scales = self._identity.full_scale_currents
        counts = iter(self.board.currents)
        x, y, z = (next(counts) / FULL_SCALE * scale if scale else 0.0 for scale in scales)
        return x, y, z

    @property
    def rate(self) -> int:
        """Sampling rate configured by the host, Hz; 0 for none."""
        return self.board.configuration.rate

    def exchange(self, now: float) -> None:
        """Exchange bytes with the host, and apply immediate commands."""
        self.faults.advance(now)
        if not self.faults.active(UNPLUG):
            self._port.plug()
        elif self._port.plugged:
            self._port.unplug()
            self.board = Board(self._identity, self._send)
        self._receive(now)
        self.board.tick(self._clock(now))
        stalled = self.faults.active(STALL)
        if self._held_out and not stalled and self._port.write(self._held_out):
            self._held_out = b""
        if not self.rate:
            self.due = math.inf
        elif self.due == math.inf:
            # The next whole multiple of the period, so that both boards sample together.
            self.due = math.ceil(now * self.rate) / self.rate
        self._apply_current(min(now, self.due))

    def step(self) -> None:
        """Take the sample that is due, and apply the currents from then on."""
        tick = self.due
        full_scale = self._identity.full_scale_acceleration
        shares = (acceleration / full_scale for acceleration in self._measure(tick))
        counts = [round(min(1.0, max(-1.0, share)) * FULL_SCALE) for share in shares]
        self.board.send_sample(counts, self._clock(tick))
        self._apply_current(tick)
        self.due += self._period

    def skip(self, before: float) -> None:
        """Skip the samples that were due before a time."""
        if self.due < before:
            self.due += math.ceil((before - self.due) / self._period) * self._period

    def close(self) -> None:
        """Remove the port."""
        self._port.unplug()

    @property
    def _period(self) -> float:
        """Time from one sample to the next, s."""
        return self.board.period / 1e3 / self._clock_rate

    def _clock(self, time: float) -> int:
        """Return the board's clock at a time in s, us."""
        return (CLOCK_START + round(time * self._clock_rate)) % CLOCKS

    def _apply_current(self, time: float) -> None:
        if self._drive and self.currents != self._driven:
            self._driven = self.currents
            self._drive(time, self._driven)

    def _receive(self, now: float) -> None:
        data = self._port.read()
        was_open, self.open = self.open, data is not None
        if data is None:
            if was_open:
                self.board.disconnect()
                self._held_out = self._held_in = b""
            return
        data = self._held_in + data
        stalled = self.faults.active(STALL)
        self._held_in = data[-BUFFER:] if stalled else b""
        if data and not stalled:
            self.board.receive(self._spoiled(data), self._clock(now))

    def _send(self, data: bytes) -> bool:
        if not (self.faults.active(STALL) or self._held_out):
            return self._port.write(self._spoiled(data))
        room = len(self._held_out) + len(data) <= BUFFER
        self._held_out += data if room else b""
        return room

    def _spoiled(self, data: bytes) -> bytes:
        """Return bytes as delivered by a line with faults."""
        random = self.faults.random
        if self.faults.strikes(DROP):
            start = random.randrange(len(data))
            data = data[:start] + data[start + random.randint(1, MOST_DROPPED) :]
        if self.faults.strikes(GARBAGE):
            start = random.randrange(len(data) + 1)
            garbage = random.randbytes(random.randint(1, MOST_GARBAGE))
            data = data[:start] + garbage + data[start:]
        return data


class CoupledArms:
    """Arms of both devices, coupled while both boards are sampled.

    With the first force the hand starts to explore, and the times of faults start. A force acts
    from its sample on, as the emulated robot has no latency.

    Parameters
    ----------
    boards : sequence of EmulatedBoard
    devices : sequence of SimulatedDevice
        Master and slave.
    coupling : PositionPositionCoupling

    Attributes
    ----------
    coupled : bool
        True while both boards are sampled.
    """

    def __init__(
        self,
        boards: Sequence[EmulatedBoard],
        devices: Sequence[SimulatedDevice],
        coupling: tick.PositionPositionCoupling,
    ) -> None:
        self._boards, self._devices, self._coupling = boards, devices, coupling
        self._tick = 0
        self._build()

    def _build(self) -> None:
        """Start with free arms."""
        self._sides = dict(zip(ARMS, map(_side, self._devices), strict=True))
        engagement = Engagement(EngagementParameters(), now=self.due)
        for arm in ARMS:
            engagement.arm_stopped(arm, False)
        self._part = tick.CouplingPart(self._coupling, engagement, 1 / STEP)
        self._loop = tick.HostLoop(self._sides, self._part, decide=self._couple)
        self.coupled = False

    @property
    def due(self) -> float:
        """Time of the next step, s."""
        return self._tick * STEP

    def skip(self, before: float) -> None:
        """Skip the forces that were due before a time."""
        self._tick = max(self._tick, math.ceil(before / STEP))

    def step(self) -> None:
        """Exchange the forces of the arms, which are free while a board is not sampled."""
        if self.coupled and not self._sampled:
            for side in self._sides.values():
                side.device.write(self.due, arm_force=ZERO)
            self._coupling.disengage()
            self._build()
        self._loop.step(self._tick)
        self._tick += 1

    @property
    def _sampled(self) -> bool:
        return all(board.rate for board in self._boards)

    def _couple(self, now: float) -> None:
        """Couple the arms, once, when both boards are sampled."""
        if not self.coupled and self._sampled:
            self.coupled = self._part.poll(now, listeners=1).engage
            for board in self._boards if self.coupled else ():
                board.faults.begin()


def _side(device: SimulatedDevice) -> tick.DeviceSide:
    """Return a device's arm behind a safety layer that allows forces."""
    safety = tick.SafetyLayer(SafetyParameters(), 1 / STEP)
    safety.enable(0.0, True)
    return tick.DeviceSide(device, safety, 1 / STEP, latency=0, kinds=[tick.ARM])


class SerialLines:
    """Boards and their arms, processed in order of time.

    Parameters
    ----------
    boards : sequence of EmulatedBoard
    arms : CoupledArms, optional

    Attributes
    ----------
    due : float
        Time of the next step, s.
    """

    def __init__(self, boards: Sequence[EmulatedBoard], arms: CoupledArms | None = None) -> None:
        self._boards = boards
        self._events: list[EmulatedBoard | CoupledArms] = [*boards]
        if arms:
            self._events.append(arms)
        self.due = 0.0

    @property
    def terminals(self) -> list[PseudoTerminal]:
        """Ports opened by hosts."""
        return [board.terminal for board in self._boards if board.terminal]

    def step(self, now: float) -> None:
        """Exchange bytes, then process all samples and forces that are due."""
        for board in self._boards:
            board.exchange(now)
        for event in self._events:
            event.skip(now - LONGEST_DELAY)
        while (event := min(self._events, key=attrgetter("due"))).due <= now:
            event.step()
        # The arms' forces are processed with the next sample, and need no wake-up of their own.
        self.due = min(now + STEP, *(board.due for board in self._boards))

    def close(self) -> None:
        """Remove the ports."""
        for board in self._boards:
            board.close()
