# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""The firmware's core, compiled for this machine and for the board's, and what it is given."""

from __future__ import annotations

import random
import shutil
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from haptic_accel.devices.serial.protocol import Frame, Identity
from running import PATIENCE

SOURCE = Path(__file__).resolve().parents[2]
SKETCH = SOURCE / "firmware" / "haptic_handle"
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
HERE = SOURCE / "test" / "firmware"


class Processor(NamedTuple):
    """A processor that the firmware's core is compiled for, and what runs the program.

    Attributes
    ----------
    compiler : list of str
        The compiler and its options.
    emulator : list of str
        Words before the program; empty on this machine.
    sources : list of Path
        Sources that only this processor needs.
    packages : str
        Packages of Debian with compiler and emulator.
    """

    compiler: list[str]
    emulator: list[str]
    sources: list[Path]
    packages: str

    def if_installed(self, name: str) -> object:
        """Return a value for pytest's parameters, skipped where a program is missing."""
        programs = [words[0] for words in (self.compiler, self.emulator) if words]
        missing = [program for program in programs if shutil.which(program) is None]
        reason = f"no {', '.join(missing)} on this machine: apt install {self.packages}"
        return pytest.param(self, id=name, marks=pytest.mark.skipif(bool(missing), reason=reason))


SANITIZED = ["g++", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
HOST = Processor(SANITIZED, [], [], "g++")
# Processor, optimization and language as for a Teensy 4.0: teensy4/Makefile of its Arduino core,
# https://github.com/PaulStoffregen/cores. The program's files are those of this machine.
CORTEX_M7 = Processor(
    [
        *("arm-none-eabi-gcc", "-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard"),
        *("-mfpu=fpv5-d16", "-O2", "-fno-exceptions", "-fno-rtti"),
        *("--specs=rdimon.specs", "-Wl,--section-start=.vectors=0"),
    ],
    [
        *("qemu-system-arm", "-machine", "mps2-an500", "-display", "none", "-monitor", "none"),
        *("-serial", "none", "-semihosting-config", "enable=on,target=native", "-kernel"),
    ],
    [HERE / "cortex_m7.cpp"],
    "gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm",
)
PROCESSORS = [HOST.if_installed("host"), CORTEX_M7.if_installed("cortex_m7")]


def compiled(folder: Path, processor: Processor) -> list[str]:
    """Compile the core for a processor, and return the command that runs it."""
    path = folder / "board"
    sources = [HERE / "host_board.cpp", SKETCH / "board.cpp", SKETCH / "protocol.cpp"]
    words = [*processor.compiler, *STRICT, f"-I{SKETCH}", *sources, *processor.sources]
    subprocess.run([*words, "-o", path], check=True)
    return [*processor.emulator, str(path)]


def run(program: list[str], identity: Identity, script: bytes) -> bytes:
    """Return what the program says to a script."""
    said = identity.pack() + script
    done = subprocess.run(program, input=said, capture_output=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def record(letter: bytes, content: bytes) -> bytes:
    return letter + struct.pack("<H", len(content)) + content


def random_frames(random: random.Random, number: int) -> Iterator[Frame]:
    for _ in range(number):
        length = random.choice((0, 1, 2, 4, random.randrange(241), 240))
        # Zeros are what COBS is about.
        payload = bytes(random.choice((0, 0, 1, random.randrange(256))) for _ in range(length))
        yield Frame(
            random.randrange(256),
            random.randrange(256),
            random.randrange(1 << 16),
            random.randrange(1 << 32),
            payload,
        )


def garbled(random: random.Random, wire: bytes) -> bytes:
    """Return bytes as a bad cable delivers them."""
    kind = random.randrange(6)
    at = random.randrange(len(wire))
    if kind == 0:
        return wire[:at] + wire[at + 1 :]
    if kind == 1:
        return wire[:at] + random.randbytes(1) + wire[at + 1 :]
    if kind == 2:
        return random.randbytes(random.randrange(600)) + wire
    return wire
