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

"""A small bag of every kind of message that is read, and what was written into it."""

from __future__ import annotations

import random
from pathlib import Path

from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.definitions import connection
from haptic_accel.bags.facts import custom_data, facts_text
from haptic_accel.bags.files import BagFiles
from haptic_accel.bags.reading import Bag
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import DIAGNOSTICS, SIGNALS

MAGIC = b"\x89MCAP0\r\n"
CHUNKS, MESSAGE_INDEXES = 6, 7
"""Kinds of records."""

START = 1_700_000_000_000_000_000
PERIOD = 1_000_000
"""Period of the samples, ns."""

SAMPLES, CHUNK = 60, 20
"""Samples of each signal, and those between two flushes, each of which ends a chunk."""

_TYPES = get_typestore(Stores.ROS2_JAZZY)


def write_small_bag(bag: Path, profile: str = "none") -> Path:
    """Write the bag; return its file, beside which there is metadata.yaml only."""
    options = RecordingOptions(storage_preset_profile=profile)
    facts = custom_data(facts_text({"surface": "vinyl", "latency": 1}, {"coupler": {"k_m": 2.5}}))
    files = BagFiles(bag, options, facts)
    signals = [
        (connection(number, f"/{topic.name}", topic.type, []), StampedVector(topic))
        for number, topic in enumerate(SIGNALS, start=1)
    ]
    diagnostics = connection(len(SIGNALS) + 1, "/diagnostics", DIAGNOSTICS.type, [])
    for topic in (*(topic for topic, _ in signals), diagnostics):
        files.add(topic)
    numbers = random.Random("bag")
    for sample in range(SAMPLES):
        stamp = START + sample * PERIOD
        for topic, message in signals:
            vector = (numbers.gauss(), numbers.gauss(), numbers.gauss())
            files.write(topic, stamp, message.pack(stamp, vector))
        if sample % CHUNK == CHUNK - 1:
            files.write(diagnostics, stamp, _diagnosis(sample))
            files.flush()
    files.close()
    return bag / f"{bag.name}_0.mcap"


def without_checksums(file: Path) -> None:
    """Take the checksums out of a bag, so that damage is not noticed by them."""
    saved = bytearray(file.read_bytes())
    summary = int.from_bytes(saved[-28:-20], "little")
    for place in (summary - 4, len(saved) - 12, *(place + 33 for place in places(file, CHUNKS))):
        saved[place : place + 4] = bytes(4)
    file.write_bytes(saved)
    metadata = file.with_name("metadata.yaml")
    metadata.write_text("".join(metadata.read_text().splitlines(keepends=True)[:-1]))


def places(file: Path, kind: int) -> list[int]:
    """Return where the records of a kind begin in a file."""
    saved, found, place = file.read_bytes(), [], len(MAGIC)
    while place < len(saved) - len(MAGIC):
        if saved[place] == kind:
            found.append(place)
        place += 9 + int.from_bytes(saved[place + 1 : place + 9], "little")
    return found


def content(bag: Bag) -> object:
    """Return all that was read, so that it can be compared."""
    signals = {
        name: (signal.stamps.tolist(), signal.received.tolist(), signal.values.tolist())
        for name, signal in bag.signals.items()
    }
    return signals, bag.diagnostics, bag.changes, bag.facts, dict(bag.counts)


def flip(content: bytes, bit: int) -> bytes:
    """Return content with one bit changed."""
    flipped = bytearray(content)
    flipped[bit // 8] ^= 1 << bit % 8
    return bytes(flipped)


def _diagnosis(ticks: int) -> bytes:
    kinds = _TYPES.types
    pair = kinds["diagnostic_msgs/msg/KeyValue"]("ticks", str(ticks))
    status = kinds["diagnostic_msgs/msg/DiagnosticStatus"](0, "coupler", "OK", "/coupler", [pair])
    header = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](0, 0), "")
    message = kinds[DIAGNOSTICS.type](header, [status])
    return bytes(_TYPES.serialize_cdr(message, DIAGNOSTICS.type))
