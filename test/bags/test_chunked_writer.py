# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from haptic_accel.bags.chunked_writer import ChunkedWriter
from haptic_accel.bags.metadata import connection

TOPICS = [connection(number, f"/{number}", "std_msgs/msg/String", []) for number in (1, 2, 3)]
ACTIONS = ["topic", "message", "flush"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("files")


@given(actions=st.lists(st.sampled_from(ACTIONS), max_size=12), compressed=st.booleans())
@settings(max_examples=50)
def test_every_chunk_has_messages_and_an_index_of_them(
    folder: Path, actions: list[str], compressed: bool
) -> None:
    path = folder / "x.mcap"
    path.unlink(missing_ok=True)
    writer = ChunkedWriter(path, compressed=compressed)
    waiting, added, written = list(TOPICS), [], []
    for number, action in enumerate(actions):
        if action == "flush":
            writer.flush()
        elif action == "topic" and waiting:
            added.append(waiting.pop())
            writer.add(added[-1])
        elif action == "message" and added:
            written.append((added[-1].topic, number))
            writer.write(added[-1], number, b"")
    writer.finish("")
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary
        rows = [(channel.topic, one.log_time) for _, channel, one in reader.iter_messages()]
        assert rows == written
        assert {channel.topic for channel in summary.channels.values()} == {
            topic.topic for topic in added
        }
        assert all(index.message_index_offsets for index in summary.chunk_indexes)
        assert all(index.message_index_length for index in summary.chunk_indexes)
        stream.seek(0)
        chunks = [
            record
            for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records
            if isinstance(record, Chunk)
        ]
    assert len(chunks) == len(summary.chunk_indexes)
    for chunk in chunks:
        assert any(isinstance(record, Message) for record in breakup_chunk(chunk))
