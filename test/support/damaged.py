# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags to damage: a small bag with every kind of message read, and the damage."""

from __future__ import annotations

import random
import shutil
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bag_maker import START, Message, diagnostics_bytes, record_messages
from haptic_accel.bags.reading import Bag
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.trial_metadata import custom_data, json_text
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import DIAGNOSTICS, SIGNALS

MAGIC = b"\x89MCAP0\r\n"
CHUNKS, MESSAGE_INDEXES = 6, 7
"""Kinds of records."""

PERIOD = 1_000_000
"""Period of the samples, ns."""

SAMPLES, CHUNK = 60, 20
"""Samples of each signal, and samples per flush, each of which ends a chunk."""


def write_small_bag(bag: Path, profile: str = "none") -> Path:
    """Write a bag of one file besides metadata.yaml; return that file."""
    numbers = random.Random("bag")
    packed = [StampedVector(topic) for topic in SIGNALS]
    messages: list[Message] = []
    flush_after: list[int] = []
    for sample in range(SAMPLES):
        stamp = START + sample * PERIOD
        for topic, message in zip(SIGNALS, packed, strict=True):
            vector = (numbers.gauss(), numbers.gauss(), numbers.gauss())
            data = message.pack(stamp, vector)
            messages.append(Message(f"/{topic.name}", topic.type, stamp, data))
        if sample % CHUNK == CHUNK - 1:
            said = diagnostics_bytes(0, "coupler", "OK", {"ticks": str(sample)})
            messages.append(Message("/diagnostics", DIAGNOSTICS.type, stamp, said))
            flush_after.append(len(messages) - 1)
    options = RecordingOptions(storage_preset_profile=profile)
    facts = json_text({"surface": "vinyl", "latency": 1}, {"coupler": {"k_m": 2.5}})
    given = {"options": options, "custom": custom_data(facts), "flush_after": flush_after}
    record_messages(bag, messages, **given).close()
    return bag / f"{bag.name}_0.mcap"


def write_cut_off_bag(bag: Path, messages: Sequence[Message], **given: Any) -> Path:
    """Write a bag as left by a recorder killed after the last message.

    Parameters are those of `record_messages`.
    """
    with TemporaryDirectory(dir=bag.parent) as folder:
        recorded = Path(folder) / bag.name
        files = record_messages(recorded, messages, **given)
        shutil.copytree(recorded, bag, copy_function=_copy_what_is_there)
        files.close()
    return bag


def _copy_what_is_there(source: str, target: str) -> None:
    """Copy a file unless it was temporary and has been renamed since the folder was listed."""
    with suppress(FileNotFoundError):
        shutil.copy2(source, target)


def write_bag_with_an_empty_chunk(bag: Path, message: Message) -> Path:
    """Write a bag with an empty chunk, then one message; return its file."""
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        types = get_typestore(Stores.ROS2_JAZZY)
        topic = writer.add_connection(message.topic, message.kind, typestore=types)
        assert writer.storage
        writer.storage.close_chunk()  # type: ignore[attr-defined]
        writer.write(topic, message.received, message.data)
    return (bag / f"{bag.name}.mcap").rename(bag / f"{bag.name}_0.mcap")


def without_checksums(file: Path) -> None:
    """Remove the checksums from a bag, so that they do not reveal damage."""
    saved = bytearray(file.read_bytes())
    summary = int.from_bytes(saved[-28:-20], "little")
    for place in (summary - 4, len(saved) - 12, *(place + 33 for place in places(file, CHUNKS))):
        saved[place : place + 4] = bytes(4)
    file.write_bytes(saved)
    metadata = file.with_name("metadata.yaml")
    metadata.write_text("".join(metadata.read_text().splitlines(keepends=True)[:-1]))


def places(file: Path, kind: int) -> list[int]:
    """Return positions of a kind of records in a file."""
    saved, found, place = file.read_bytes(), [], len(MAGIC)
    while place < len(saved) - len(MAGIC):
        if saved[place] == kind:
            found.append(place)
        place += 9 + int.from_bytes(saved[place + 1 : place + 9], "little")
    return found


def content(bag: Bag) -> object:
    """Return all content that was read, for comparison."""
    found = bag.signals.items()
    arrays = {name: (each.stamps, each.received, each.values) for name, each in found}
    signals = {name: [each.tolist() for each in arrays[name]] for name in arrays}
    return signals, bag.diagnostics, bag.changes, bag.metadata, dict(bag.counts)


def flip(content: bytes, bit: int) -> bytes:
    """Return content with one bit changed."""
    flipped = bytearray(content)
    flipped[bit // 8] ^= 1 << bit % 8
    return bytes(flipped)
