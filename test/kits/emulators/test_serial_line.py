# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Emulated boards and their coupled arms, stepped without a clock."""

from __future__ import annotations

import fcntl
import os
import select
import struct
import termios
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from haptic_accel.core.coupling.passive import CouplingParameters
from haptic_accel.core.model import Vector
from haptic_accel.core.rig.master_rig import MasterRigParameters
from haptic_accel.core.tick import PositionPositionCoupling
from haptic_accel.devices import simulated
from haptic_accel.devices.serial import protocol
from haptic_accel.kits.emulators import serial_line
from haptic_accel.kits.emulators.ports import PseudoTerminal
from running import wait_until

HANDLE = protocol.Identity((1, 0, 0), 0b100, 5000, 49.0, (0.0, 0.0, 2.75), "handle")
STEP = 1e-3  # s


def acceleration(device: Any, time: float) -> Any:
    return device.read(time).acceleration


class Bench:
    """Two boards with simulated devices, and their hosts."""

    def __init__(self, folder: Path) -> None:
        self.devices = (
            simulated.SimulatedMaster(MasterRigParameters(), 1000.0, 0),
            simulated.SimulatedSlave(simulated.SimulatedSlaveParameters(), 1000.0, 0),
        )
        self.currents: list[float] = []
        self.changes: list[float] = []
        ports = [folder / f"port{place}" for place in range(2)]
        felt = (partial(acceleration, device) for device in self.devices)
        self.boards = [
            serial_line.EmulatedBoard(HANDLE, port, measure, self.drive)
            for port, measure in zip(ports, felt, strict=True)
        ]
        coupling = PositionPositionCoupling(CouplingParameters())
        self.arms = serial_line.CoupledArms(self.boards, self.devices, coupling)
        self.lines = serial_line.SerialLines(self.boards, self.arms)
        self.hosts = [os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK) for port in ports]
        self.encoder = protocol.Encoder()
        self.now = 0.0
        self.lines.step(self.now)  # the boards see their hosts

    def drive(self, time: float, currents: Vector) -> None:
        self.changes.append(time)
        self.currents.append(currents[2])

    def say(self, place: int, *messages: protocol.Message) -> None:
        terminal = self.boards[place].terminal
        assert terminal
        data = b"".join(self.encoder.encode(message, 0) for message in messages)
        there = waiting(terminal) + len(data)
        os.write(self.hosts[place], data)
        # The kernel passes bytes on in its own time.
        wait_until(lambda: waiting(terminal) == there, "all bytes are at the board's end")

    def go_on(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            self.lines.step(self.now)

    def received(self, place: int) -> list[protocol.Samples]:
        data = b""
        while select.select([self.hosts[place]], [], [], 0.1)[0]:
            data += os.read(self.hosts[place], 1 << 16)
        messages = map(protocol.read_message, protocol.Decoder().feed(data))
        return [message for message in messages if isinstance(message, protocol.Samples)]


def waiting(terminal: PseudoTerminal) -> int:
    """Return the number of bytes that can be read."""
    (count,) = struct.unpack("i", fcntl.ioctl(terminal, termios.FIONREAD, bytes(4)))
    return int(count)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    yield bench
    for host in bench.hosts:
        os.close(host)
    for board in bench.boards:
        board.close()


def test_arms_are_coupled_once_both_boards_are_sampled(bench: Bench) -> None:
    bench.say(0, protocol.Configure(1000, 4, 1))
    bench.go_on(0.05)
    assert not bench.arms.coupled
    bench.say(1, protocol.Configure(1000, 4, 1))
    bench.go_on(0.01)
    assert bench.arms.coupled
    assert all(board.faults.begun for board in bench.boards)
    start = [device.read(bench.now).position for device in bench.devices]
    bench.go_on(0.6)
    # The hand goes down, and the slave's tip with it, 1 mm at least.
    for device, before in zip(bench.devices, start, strict=True):
        assert device.read(bench.now).position[2] < before[2] - 1e-3


def test_arms_are_free_while_a_board_is_not_sampled_and_couple_as_at_first(bench: Bench) -> None:
    start = [device.read(bench.now).position for device in bench.devices]
    for _ in range(2):
        for place in range(2):
            bench.say(place, protocol.Configure(1000, 4, 1))
        bench.go_on(1.0)
        assert bench.arms.coupled
        assert bench.devices[0].read(bench.now).position != start[0]
        bench.say(1, protocol.Configure(0, 4, 1))
        bench.go_on(1.0)
        assert not bench.arms.coupled
        assert [device.read(bench.now).position for device in bench.devices] == start


def test_samples_are_taken_at_the_rate_of_the_host(bench: Bench) -> None:
    bench.say(0, protocol.Configure(500, 4, 2))
    bench.go_on(0.1)
    found = bench.received(0)
    assert [samples.index for samples in found] == list(range(0, 2 * len(found), 2))
    assert len(found) == pytest.approx(25, abs=1)
    # A wake-up that comes late loses none; those of a long stall are not made up for.
    bench.now += 0.05
    bench.go_on(0.05)
    assert len(bench.received(0)) == pytest.approx(25, abs=1)
    bench.now += 10.0
    bench.go_on(0.02)
    assert len(bench.received(0)) <= 31


def test_the_current_of_a_board_drives_its_actuator(bench: Bench) -> None:
    bench.say(0, protocol.ArmRequest(), protocol.SetCurrent((protocol.FULL_SCALE,)))
    bench.go_on(0.002)
    assert bench.currents == [2.75]
    bench.go_on(0.01)
    assert bench.currents == [2.75, 0.0], "the board's own time-out"


def test_a_late_wake_up_applies_each_set_point_at_its_tick(bench: Bench) -> None:
    bench.say(0, protocol.Configure(1000, 4, 1), protocol.ArmRequest())
    bench.go_on(0.004)
    stamp = serial_line.CLOCK_START + 4000
    for place in (1, 2):
        due = (stamp + 1000 * place) % protocol.CLOCKS
        bench.say(0, protocol.ScheduleCurrent((protocol.FULL_SCALE // place,), due))
    bench.now = 0.0085
    bench.go_on(STEP)
    assert bench.changes[:2] == pytest.approx([0.005, 0.006])
    assert bench.currents[:2] == pytest.approx([2.75, 2.75 / 2], rel=1e-3)
