# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Generated frames through the serial protocol: ``python benchmarks/serial_protocol.py``."""

from __future__ import annotations

import random
import time
from collections import Counter
from pathlib import Path

import click

from haptic_accel import ParameterError
from haptic_accel.commands import DONE, FAILED, Verb, json_option, run, save
from haptic_accel.devices.serial.protocol import (
    DELIMITER,
    FULL_SCALE,
    VERSION,
    Decoder,
    Frame,
    FrameType,
    Identity,
    PayloadError,
    ScheduleCurrent,
    SetCurrent,
    State,
    encode,
    read_message,
)
from haptic_accel.kits.emulators.serial_line import Board

COILS = 3
"""Number of the board's coils."""

SPOILED = 0.1
"""Fraction of the frames that are damaged on the way."""

MOST_GARBAGE = 300
"""Most random bytes inserted at a time: more than the length of a frame."""


@click.command(cls=Verb)
@click.option("--frames", type=int, default=100_000, help="Number of frames.")
@click.option("--seed", type=int, default=1, help="Seed of the frames and of their damage.")
@json_option
def serial_protocol(*, frames: int, seed: int, json_file: Path | None) -> int:
    """Send generated frames through decoder and board of the serial protocol.

    A tenth of them is damaged. The exit status is 1 if one is missed, or a current flows that
    must not.
    """
    if frames < 1:
        raise ParameterError(f"frames = {frames}: must be at least 1")
    line = _Line(seed)
    start = time.perf_counter()
    for _ in range(frames):
        line.step()
    line.finish()
    seconds = round(time.perf_counter() - start, 1)
    results = {"frames": frames, "seed": seed, **line.counts, "seconds": seconds}
    for name, value in results.items():
        print(f"{name.replace('_', ' ')}: {value}")
    save(results, json_file)
    return DONE if not (line.counts["missed"] or line.counts["unlawful"]) else FAILED


class _Line:
    """A sender, a disturbed line, a decoder and a board."""

    def __init__(self, seed: int) -> None:

        self._random = random.Random(seed)
        self._decoder = Decoder()
        self._board = Board(
            Identity((1, 0, 0), 0b111, 10_000, 84.6, (2.75, 2.75, 2.75), "bench"),
            self._count_answer,
        )
        self._now = 0
        self._wire = b""
        self._whole: list[Frame] = []
        self.counts: Counter[str] = Counter(
            dict.fromkeys(("spoiled", "found", "missed", "damaged", "answers", "unlawful"), 0)
        )

    def step(self) -> None:
        """Send one frame; now and then deliver what was sent."""
        frame = self._frame()
        wire = encode(frame)
        if self._random.random() < SPOILED:
            self.counts["spoiled"] += 1
            # A delimiter, so that the damage is limited to this frame.
            self._wire += self._spoiled(wire) + DELIMITER
        else:
            self._wire += wire
            self._whole.append(frame)
        if self._random.random() < 0.1:
            self._arrive()

    def finish(self) -> None:
        """Deliver the rest."""
        self._arrive()
        self.counts["damaged"] = self._decoder.damaged

    def _frame(self) -> Frame:
        """Return a random frame: half are valid commands of a host, half are arbitrary."""
        rng = self._random
        kind: int
        if rng.random() < 0.5:
            kind, length = rng.choice(
                [
                    (FrameType.SET_CURRENT, SetCurrent.size(COILS)),
                    (FrameType.SCHEDULE_CURRENT, ScheduleCurrent.size(COILS)),
                    (FrameType.ALIGN, 8),
                    (FrameType.ARM, 0),
                    (FrameType.CONFIGURE, 4),
                    (FrameType.IDENTIFY, 0),
                    (FrameType.DISARM, 0),
                ]
            )
            version = VERSION
        else:
            version, kind = rng.choice((VERSION, rng.randrange(256))), rng.randrange(256)
            length = rng.randrange(241)
        payload = rng.randbytes(length)
        return Frame(version, kind, rng.randrange(1 << 16), rng.randrange(1 << 32), payload)

    def _spoiled(self, wire: bytes) -> bytes:
        """Return bytes with some of them changed, lost, or inserted."""
        rng = self._random
        at = rng.randrange(len(wire) - 1)
        kind = rng.randrange(3)
        if kind == 0:
            # A different byte, so that the frame cannot be the one sent.
            return wire[:at] + bytes([wire[at] ^ rng.randrange(1, 256)]) + wire[at + 1 :]
        if kind == 1:
            return wire[:at] + wire[at + rng.randint(1, 8) :]
        return rng.randbytes(rng.randint(1, MOST_GARBAGE)) + wire[at + 1 :]

    def _arrive(self) -> None:
        """Deliver the bytes in pieces, and check the board after each."""
        rng = self._random
        found = []
        wire, self._wire = self._wire, b""
        while wire:
            cut = rng.randint(1, 400)
            piece, wire = wire[:cut], wire[cut:]
            frames = self._decoder.feed(piece)
            for frame in frames:
                self._understand(frame)
            found += frames
            self._now = (self._now + rng.choice((100, 1000, 6000))) % (1 << 32)
            self._board.receive(piece, self._now)
            self._board.send_sample((rng.randrange(-32768, 32768),) * 3, self._now)
            self._board.tick(self._now)
            self._look()
        self._compare(found)

    def _understand(self, frame: Frame) -> None:

        try:
            read_message(frame)
        except PayloadError:
            self.counts["nonsense"] += 1

    def _compare(self, found: list[Frame]) -> None:
        """Check that undamaged frames were found in order; count others as found by chance."""
        rest = iter(found)
        for frame in self._whole:
            for candidate in rest:
                if candidate == frame:
                    self.counts["found"] += 1
                    break
                self.counts["by_chance"] += 1
            else:
                self.counts["missed"] += 1
        self.counts["by_chance"] += len(list(rest))
        self._whole.clear()

    def _look(self) -> None:

        board = self._board
        armed = board.state is State.ARMED
        largest = max(map(abs, board.currents))
        if largest > FULL_SCALE or (largest and not armed):
            self.counts["unlawful"] += 1

    def _count_answer(self, data: bytes) -> bool:
        self.counts["answers"] += 1
        return True


if __name__ == "__main__":
    run(serial_protocol, "serial_protocol.py")
