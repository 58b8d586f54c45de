# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The firmware's protocol, compiled for host and board, beside the Python side: byte for byte."""

from __future__ import annotations

import random
import struct
import subprocess
from pathlib import Path

import pytest

import host_firmware
from haptic_accel.devices.serial import protocol

HANDLE = protocol.Identity((1, 2, 3), 0b101, 10_000, 84.6, (0.0, 0.0, 2.75), "7654321")
FRAMES = 3_000


@pytest.mark.parametrize("processor", host_firmware.PROCESSORS)
def test_both_sides_read_and_write_the_same_bytes(
    tmp_path: Path, processor: host_firmware.Processor
) -> None:
    rng = random.Random(1)
    decoder = protocol.Decoder()
    script, expected = [], []
    for frame in host_firmware.random_frames(rng, FRAMES):
        wire = host_firmware.garbled(rng, protocol.encode(frame))
        script.append(b"e" + struct.pack("<H", len(wire)) + wire)
        expected += [
            host_firmware.record(b"F", protocol.encode(found)) for found in decoder.feed(wire)
        ]
        counts = struct.pack("<III", decoder.received, decoder.damaged, decoder.lost)
        expected.append(host_firmware.record(b"C", counts))
    assert decoder.received > FRAMES / 3
    assert decoder.damaged > FRAMES / 20
    program = host_firmware.compiled(tmp_path, processor)
    assert host_firmware.run(program, HANDLE, b"".join(script)) == b"".join(expected)


@pytest.mark.parametrize("processor", host_firmware.PROCESSORS)
@pytest.mark.parametrize("coils", [0, 1, 3])
def test_the_sketch_compiles(coils: int, processor: host_firmware.Processor) -> None:
    sketch = host_firmware.SKETCH / "haptic_handle.ino"
    words = [
        *processor.compiler,
        "-fsyntax-only",
        *host_firmware.STRICT,
        f"-I{host_firmware.HERE / 'arduino'}",
    ]
    words += ["-include", "Arduino.h", f"-DCOILS={coils}", "-x", "c++", str(sketch)]
    subprocess.run(words, check=True)


def test_the_sketch_states_the_version_that_the_driver_asks_for() -> None:
    sketch = (host_firmware.SKETCH / "haptic_handle.ino").read_text(encoding="utf-8")
    assert f"{{{', '.join(map(str, protocol.FIRMWARE))}}}, AXES" in sketch
    assert f"uint8_t VERSION = {protocol.VERSION};" in (
        host_firmware.SKETCH / "protocol.h"
    ).read_text(encoding="utf-8")


def test_the_numbers_of_frames_are_alike() -> None:
    header = (host_firmware.SKETCH / "protocol.h").read_text(encoding="utf-8")
    for kind in protocol.FrameType:
        assert f"  {kind.name} = 0x{kind:02X},\n" in header
