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

"""The firmware's core, compiled for this machine, and what it is given."""

from __future__ import annotations

import random
import struct
import subprocess
from collections.abc import Iterator
from pathlib import Path

from haptic_accel.devices.serial.protocol import Frame, Identity

SOURCE = Path(__file__).resolve().parents[2]
SKETCH = SOURCE / "firmware" / "haptic_handle"
STRICT = ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]
CHECKED = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def compiled(folder: Path) -> Path:
    """Compile the core as the board does, but for the host, and with its errors looked for."""
    path = folder / "host_board"
    host = SOURCE / "test" / "firmware" / "host_board.cpp"
    sources = [host, SKETCH / "board.cpp", SKETCH / "protocol.cpp"]
    subprocess.run(["g++", *STRICT, *CHECKED, f"-I{SKETCH}", *sources, "-o", path], check=True)
    return path


def run(program: Path, identity: Identity, script: bytes) -> bytes:
    """Return what the program says to a script."""
    done = subprocess.run(
        [program], input=identity.pack() + script, capture_output=True, timeout=60
    )
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
