# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Compressed bags that expand to more than any bag does: read up to a bound."""

from __future__ import annotations

import sqlite3
import struct
from contextlib import closing
from pathlib import Path

import pytest
from backports import zstd
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from bag_maker import STRING, Message, write_messages
from damaged import CHUNKS, MAGIC
from fuzzing import measured
from haptic_accel.bags.compression import ALWAYS, LARGEST_RECORD
from haptic_accel.bags.reading import read_bag
from haptic_accel.core.parameters import ParameterError

ZEROS = bytes(1 << 26)


def small_bag(path: Path, storage: StoragePlugin, mode: CompressionMode, data: bytes) -> Path:
    messages = (Message("/text", STRING, number, data) for number in range(10))
    return write_messages(path, messages, storage=storage, compression=mode)


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_file_that_expands_is_not_decompressed_to_its_end(
    tmp_path: Path, storage: StoragePlugin
) -> None:
    bag = small_bag(tmp_path / "bag", storage, CompressionMode.FILE, b"1234")
    (file,) = bag.glob("*.zstd")
    with zstd.open(file, "ab") as more:
        for _ in range(10):
            more.write(ZEROS)
    with measured(megabytes=300), pytest.raises(ParameterError, match="it expands to more than"):
        read_bag(bag)


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_message_that_expands_is_not_read(tmp_path: Path, storage: StoragePlugin) -> None:
    bag = small_bag(tmp_path / "bag", storage, CompressionMode.MESSAGE, ZEROS)
    with measured(), pytest.raises(ParameterError, match="it expands to more than"):
        read_bag(bag)


def test_chunks_that_expand_are_read_up_to_a_bound(tmp_path: Path) -> None:
    stored = zstd.compress(ZEROS[:LARGEST_RECORD])
    name = struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(stored))
    chunk = struct.pack("<QQQI", 0, 0, LARGEST_RECORD, 0) + name + stored
    file = tmp_path / "bomb.mcap"
    file.write_bytes(MAGIC + (struct.pack("<BQ", CHUNKS, len(chunk)) + chunk) * 1000)
    most = ALWAYS + 100 * file.stat().st_size
    with measured(), pytest.raises(ParameterError, match=f"it expands to more than {most} bytes"):
        read_bag(file)


ENDLESS = """
DROP TABLE messages;
CREATE VIEW messages AS
    WITH RECURSIVE numbers(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM numbers)
    SELECT n AS id, 1 AS topic_id, n AS timestamp, zeroblob(100000000) AS data FROM numbers;
"""
COMPUTED = (
    "ALTER TABLE messages ADD COLUMN more BLOB GENERATED ALWAYS AS (zeroblob(1000000000)) VIRTUAL"
)


@pytest.mark.parametrize("statements", [ENDLESS, COMPUTED])
def test_rows_that_are_computed_are_not_read(tmp_path: Path, statements: str) -> None:
    bag = small_bag(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.NONE, b"1234")
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.executescript(statements)
    with measured(), pytest.raises(ParameterError, match="it has computed rows"):
        read_bag(bag)


def test_messages_that_are_not_yet_in_the_file_are_told(tmp_path: Path) -> None:
    bag = small_bag(tmp_path / "bag", StoragePlugin.SQLITE3, CompressionMode.NONE, b"1234")
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("UPDATE messages SET timestamp = timestamp + 1")
        database.commit()
        assert f"{file.name}-wal is not read: sqlite3 adds" in " ".join(read_bag(bag).problems)
    assert read_bag(bag).problems == []
