# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The emulated board beside the firmware, for host and board: the same states and bytes."""

from __future__ import annotations

import random
import struct
from pathlib import Path

import pytest

from haptic_accel.core.axes import NAMES
from haptic_accel.devices.serial import protocol
from haptic_accel.kits.emulators.serial_line import Board
from host_firmware import PROCESSORS, Processor, compiled, garbled, random_frames, record, run

HANDLE = protocol.Identity((1, 2, 3), 0b101, 10_000, 84.6, (0.0, 0.0, 2.75), "7654321")
THREE = protocol.Identity((1, 2, 3), 0b111, 10_000, 84.6, (2.75, 1.0, 0.5), "three coils")
TOOL = protocol.Identity((1, 0, 0), 0b111, 4000, 49.0, (0.0, 0.0, 0.0), "sixteen letters!")
STEPS = 5_000


class Pair:
    """A board in Python, and the script that makes the one in C++ do the same."""

    def __init__(self, identity: protocol.Identity) -> None:
        self.script: list[bytes] = []
        self.expected: list[bytes] = []
        self.room = True
        self.status: protocol.Status | None = None
        self.coils = identity.coils
        self.board = Board(identity, self._send)

    def _send(self, wire: bytes) -> bool:
        (frame,) = protocol.Decoder().feed(wire)
        if frame.type == protocol.FrameType.STATUS:
            self.status = protocol.Status.unpack(frame.payload)
        if self.room:
            self.expected.append(record(b"F", wire))
        return self.room

    def receive(self, data: bytes, now: int) -> None:
        self.script.append(b"r" + struct.pack("<IH", now, len(data)) + data)
        self.board.receive(data, now)

    def sample(self, values: tuple[int, int, int], now: int) -> None:
        self.script.append(b"s" + struct.pack("<I3h", now, *values))
        self.board.send_sample(values, now)

    def tick(self, now: int) -> None:
        self.script.append(b"t" + struct.pack("<I", now))
        self.board.tick(now)

    def fault(self, present: bool, now: int) -> None:
        self.script.append(b"f" + struct.pack("<?I", present, now))
        self.board.fault(present, now)

    def disconnect(self) -> None:
        self.script.append(b"d")
        self.board.disconnect()

    def have_room(self, room: bool) -> None:
        self.script.append(b"m" + struct.pack("<?", room))
        self.room = room

    def look(self) -> None:
        board = self.board
        rate = board.configuration.rate
        flowing = dict(zip(self.coils, board.currents, strict=True))
        currents = [flowing.get(axis, 0) for axis in NAMES]
        state = struct.pack("<B3hHI", board.state, *currents, rate, board.period)
        self.expected.append(record(b"S", state))


def random_message(random: random.Random, now: int, coils: int) -> protocol.Message:
    counts = tuple(random.randrange(-32768, 32768) for _ in range(coils))
    extremes = tuple(random.choice((-32768, -32767, 0, 1, 32767)) for _ in range(coils))
    near = (now + random.choice((-600_000, -500, 0, 500, 1500, 6000, 600_000))) % protocol.CLOCKS
    periods = (1_000_000, 1_000_100, 100_000, 984_375, 1_015_626, 0, protocol.CLOCKS - 1)
    period = random.choice(periods)
    return random.choice(
        [
            protocol.SetCurrent(extremes),
            *[protocol.ScheduleCurrent(counts, near)] * 6,
            protocol.Align(near, period),
            protocol.Align(random.randrange(protocol.CLOCKS), period),
            protocol.ArmRequest(),
            protocol.DisarmRequest(),
            protocol.Identify(),
            protocol.Configure(
                random.choice((0, 49, 50, 1000, 10_000, 10_001)),
                random.choice((0, 1, 4, 5, 7, 255)),
                random.choice((0, 1, 2, 4, 58, 59, 255)),
            ),
        ]
    )


@pytest.mark.parametrize("processor", PROCESSORS)
@pytest.mark.parametrize("identity", [HANDLE, THREE, TOOL], ids=["handle", "three", "tool"])
def test_both_boards_do_the_same_whatever_comes(
    tmp_path: Path, identity: protocol.Identity, processor: Processor
) -> None:
    rng = random.Random(2)
    encoder = protocol.Encoder()
    pair = Pair(identity)
    now = (1 << 32) - 10_000_000  # the clock begins again on the way
    coils = len(identity.coils)
    states, periods = set(), set()
    for _ in range(STEPS):
        now = (now + rng.choice((1, 100, 500, 1000, 1000, 4999, 6000))) % (1 << 32)
        chance = rng.random()
        if chance < 0.01:
            due = [now + rng.randrange(100_000) for _ in range(40)]
            burst = (
                protocol.ScheduleCurrent((each % 100,) * coils, each % protocol.CLOCKS)
                for each in due
            )
            pair.receive(b"".join(encoder.encode(each, now) for each in burst), now)
        elif chance < 0.5:
            # Now and then one coil too many, which is refused.
            most = coils + (rng.random() < 0.1 and coils < 3)
            wire = encoder.encode(random_message(rng, now, most), now)
            pair.receive(wire if rng.random() < 0.8 else garbled(rng, wire), now)
        elif chance < 0.55:
            pair.receive(protocol.encode(next(random_frames(rng, 1))), now)
        elif chance < 0.8:
            x, y, z = (rng.randrange(-32768, 32768) for _ in range(3))
            pair.sample((x, y, z), now)
        elif chance < 0.99:
            pair.tick(now)
        elif chance < 0.994:
            pair.fault(rng.random() < 0.3, now)
        elif chance < 0.997:
            pair.have_room(rng.random() < 0.8)
        else:
            pair.disconnect()
        pair.look()
        states.add(pair.board.state)
        periods.add(pair.board.period)
    assert len(states) == (4 if coils else 2)
    assert len(periods) > 20
    assert pair.status
    assert min(pair.status.late, pair.status.overflowed, pair.status.refused) > 0 or not coils
    program = compiled(tmp_path, processor)
    assert run(program, identity, b"".join(pair.script)) == b"".join(pair.expected)
