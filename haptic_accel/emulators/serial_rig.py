"""The virtual rig behind two emulated boards, in real time."""

from __future__ import annotations

import math
import random
import select
import time
from collections.abc import Callable, Sequence

from haptic_accel.core.coupling.position_position import PositionPositionCoupling
from haptic_accel.core.rig.interface import Rig
from haptic_accel.core.rig.master_rig import MasterRig
from haptic_accel.core.rig.slave_rig import SlaveRig
from haptic_accel.core.trial import DEFAULT_RATE, RigParameters
from haptic_accel.emulators.serial_faults import OFTEN, PlannedFault
from haptic_accel.emulators.serial_line import EmulatedBoard

STEP = 1e-3
"""Period of the coupling and of the boards' look at the time, s (paper's servo loop)."""

LONGEST_DELAY = 0.1
"""Time after which samples that are due are given up, s."""


class Side:
    """A board and what its accelerometer is mounted on."""

    def __init__(self, board: EmulatedBoard, rig: Rig) -> None:
        self.board = board
        self.rig = rig
        self._rate = 0
        self._next = 0.0

    @property
    def due(self) -> float:
        """When the next sample is to be taken, s."""
        return self._next if self._rate else math.inf

    def look(self, now: float) -> None:
        """Let the board take what its host sent, and its rate."""
        self.board.look(now)
        if self.board.rate != self._rate:
            self._rate = self.board.rate
            self._skip_to(now)

    def take_samples(self, now: float) -> None:
        """Take what is due, each at its time."""
        if self._rate and now - self._next > LONGEST_DELAY:
            self._skip_to(now)
        while self.due <= now:
            self.rig.advance(self._next)
            self.board.sample(self.rig.measure().acceleration, self._next)
            self._next += 1 / self._rate

    def _skip_to(self, now: float) -> None:
        """Go on at the next whole multiple of the period, so that both sides wake together."""
        if self._rate:
            self._next = math.ceil(now * self._rate) / self._rate


class Emulator:
    """Both boards of a rig whose arms are coupled inside it, with a hand that explores.

    The hand begins when both boards are sampled.

    Parameters
    ----------
    rig : RigParameters
    master, slave : EmulatedBoard
    force_constant : float
        Of the actuator, N/A.
    faults : sequence of PlannedFault
        Times from when the hand begins.
    faulty : EmulatedBoard
        That has them.
    fault_seconds : float
        How long a stall or an unplugging lasts that has a time.
    seed : int
    """

    def __init__(
        self,
        rig: RigParameters,
        master: EmulatedBoard,
        slave: EmulatedBoard,
        *,
        force_constant: float,
        faults: Sequence[PlannedFault] = (),
        faulty: EmulatedBoard | None = None,
        fault_seconds: float = 1.0,
        seed: int = 0,
    ) -> None:
        self._master_rig = MasterRig(rig.master, DEFAULT_RATE, seed)
        self._slave_rig = SlaveRig(rig.slave, DEFAULT_RATE, seed)
        self._coupling = PositionPositionCoupling(rig.coupling)
        self._force_constant = force_constant
        self._master = Side(master, self._master_rig)
        self._slave = Side(slave, self._slave_rig)
        self._sides = self._master, self._slave
        self._current = 0.0
        self._faults = list(faults)
        self._faulty = faulty or master
        self._fault_seconds = fault_seconds
        self._random = random.Random(seed)
        self._next_step = 0.0
        self._began: float | None = None

    @property
    def exploring(self) -> bool:
        """Whether the hand has begun."""
        return self._began is not None

    def run(self, ended: Callable[[], bool]) -> None:
        """Go on until it is ended, asked once a step."""
        start = time.monotonic()
        while not ended():
            self._wait(start)
            now = time.monotonic() - start
            for side in self._sides:
                side.look(now)
            self._drive(now)
            for side in self._sides:
                side.take_samples(now)
            if now >= self._next_step:
                self._next_step = now + STEP
                self._step(now)

    def _wait(self, start: float) -> None:
        """Wait for the next thing due, or for bytes of a host."""
        ports = [side.board.port for side in self._sides]
        due = min(self._next_step, *(side.due for side in self._sides))
        patience = max(0.0, due - (time.monotonic() - start))
        select.select([port for port in ports if port], [], [], patience)

    def _drive(self, now: float) -> None:
        """Let the actuator have the current that its board gives it."""
        current = self._master.board.current
        if current != self._current:
            self._current = current
            self._master_rig.advance(now)
            self._master_rig.apply_actuator_force(current * self._force_constant)

    def _step(self, now: float) -> None:
        """Couple the arms, and see what is to go wrong."""
        for side in self._sides:
            side.rig.advance(now)
        if self._began is None and all(side.board.rate for side in self._sides):
            self._began = now
        if self._began is None:
            return
        handle, tool = self._master_rig.measure(), self._slave_rig.measure()
        if not self._coupling.engaged:
            self._coupling.engage(handle.position, tool.position)
        on_master, on_slave = self._coupling.forces(
            handle.position, tool.position, handle.velocity, tool.velocity
        )
        self._master_rig.apply_arm_force(on_master)
        self._slave_rig.apply_arm_force(on_slave)
        self._go_wrong(now)

    def _go_wrong(self, now: float) -> None:
        assert self._began is not None
        for fault in list(self._faults):
            if fault.time is None:
                if self._random.random() < OFTEN[fault.name] * STEP:
                    self._faulty.suffer(fault.name, now)
            elif now - self._began >= fault.time:
                self._faults.remove(fault)
                self._faulty.suffer(fault.name, now, self._fault_seconds)
