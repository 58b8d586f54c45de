# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records of the MCAP format for reader and writer.

Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from io import BytesIO
from typing import BinaryIO, NamedTuple

MAGIC = b"\x89MCAP0\r\n"
NEVER = 2**63 - 1
"""Start time of a file without messages, ns, as in rosbag2; all messages are earlier."""

# Kinds of records.
NOTHING, HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(9)
STATISTICS, METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END = range(11, 16)

RECORD = struct.Struct("<BQ")  # kind, and length of the content
MESSAGE_HEADER = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CHUNK_HEADER = struct.Struct("<QQQI")  # start, end, uncompressed size, CRC-32 of the records
# Start and end time; position and length of the chunk; length of the following map of channels.
CHUNK_INDEX_HEADER = struct.Struct("<QQQQI")
# Numbers of messages, schemas, channels, attachments, metadata, chunks; start, end; counts' size.
STATISTICS_HEADER = struct.Struct("<QHIIIIQQI")
COUNT = struct.Struct("<HQ")  # channel, and messages or a position
SPAN = struct.Struct("<QQ")  # position and length, or two positions
LENGTH = struct.Struct("<Q")
TEXT_LENGTH = struct.Struct("<I")
SUM = struct.Struct("<I")  # CRC-32; 0 for none


class Schema(NamedTuple):
    """Definition of a message type: number from 1, name, encoding (``ros2msg``), and text."""

    id: int
    name: str
    encoding: str
    data: str


class Channel(NamedTuple):
    """Topic: number, name of its type, name, serialisation format, and texts by name."""

    id: int
    schema: str
    topic: str
    message_encoding: str
    metadata: bytes


@dataclass
class Tally:
    """Number and times of the messages in a file.

    Attributes
    ----------
    counts : Counter
        Number of messages by channel.
    start, end : int
        Recording times of the first and the last message, system time in ns; `NEVER` and 0 without
        messages.
    """

    counts: Counter[int] = field(default_factory=Counter)
    start: int = NEVER
    end: int = 0

    @property
    def messages(self) -> int:
        """Number of messages."""
        return self.counts.total()

    def plus(self, counts: Counter[int], start: int, end: int) -> Tally:
        """Return the tally including more messages."""
        return Tally(self.counts + counts, min(self.start, start), max(self.end, end))


def record(kind: int, *parts: bytes) -> bytes:
    """Return a record."""
    content = b"".join(parts)
    return RECORD.pack(kind, len(content)) + content


def text(value: str) -> bytes:
    """Return a text as bytes, preceded by its length."""
    content = value.encode()
    return TEXT_LENGTH.pack(len(content)) + content


def text_map(texts: Mapping[str, str]) -> bytes:
    """Return texts by name as bytes, without their total length."""
    return b"".join(text(name) + text(value) for name, value in texts.items())


def read_text(content: BinaryIO) -> str:
    """Return the text in an output of `text`."""
    (length,) = TEXT_LENGTH.unpack(content.read(TEXT_LENGTH.size))
    return content.read(length).decode("utf-8", "replace")


def read_text_map(content: bytes) -> dict[str, str]:
    """Return the texts by name in an output of `text_map`."""
    stream, texts = BytesIO(content), {}
    while stream.tell() < len(content):
        name = read_text(stream)
        texts[name] = read_text(stream)
    return texts
