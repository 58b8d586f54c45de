"""Reads an MCAP file whole, by chunks rather than by messages, and as far as it is intact.

The readers of `rosbags` and `mcap` give one message at a time, which for ten minutes of this graph
takes a minute or two, and refuse a file that was cut off. Here a chunk's messages stay one block
of bytes with the places of the messages in it.
Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, NamedTuple

import numpy as np
import numpy.typing as npt

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # as rosbags has it

IntArray = npt.NDArray[np.int64]
ByteArray = npt.NDArray[np.uint8]

MAGIC = b"\x89MCAP0\r\n"

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _INDEX, _METADATA, _END = 3, 4, 5, 6, 7, 12, 15
_RECORD = struct.Struct("<BQ")  # kind and length of what follows
_MESSAGE_HEADER = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK_HEADER = struct.Struct("<QQQI")  # start, end, uncompressed size, CRC
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])

DATA = _RECORD.size + _MESSAGE_HEADER.size
"""Where a message's data starts behind its record's start, bytes."""


class Channel(NamedTuple):
    """A topic of a file.

    Attributes
    ----------
    topic, type : str
        Full name, and type as in ``geometry_msgs/msg/AccelStamped``.
    """

    topic: str
    type: str


@dataclass(frozen=True)
class Block:
    """Messages of one channel that lie in one block of bytes.

    Attributes
    ----------
    channel : Channel
    received : ndarray of int64, shape (n,)
        When each was recorded, system time in ns.
    bytes : ndarray of uint8
        The block.
    starts, ends : ndarray of int64, shape (n,)
        Where each message's data lies in it.
    """

    channel: Channel
    received: IntArray
    bytes: ByteArray
    starts: IntArray
    ends: IntArray


@dataclass
class McapFile:
    """An MCAP file, read by iterating over `blocks`.

    Attributes
    ----------
    channels : dict
        By number, as far as read.
    metadata : dict
        Texts of the metadata records, by record and key.
    problems : list of str
        What keeps the file from being whole; to be looked at after reading.
    end : int
        Where the last intact record ends, bytes; after reading.
    """

    path: Path
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    end: int = 0
    _schemas: dict[int, str] = field(default_factory=dict)

    def blocks(self) -> Iterator[Block]:
        """Yield the messages in the order of the file, a block per chunk and channel.

        Raises
        ------
        ValueError
            It is not an MCAP file.
        OSError
            It cannot be read.
        """
        with self.path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise ValueError("it is not an MCAP file")
            chunk: bytes | None = None
            index: dict[int, npt.NDArray[np.void]] = {}
            for kind, content in self._records(file):
                if kind == _INDEX:
                    number, length = struct.unpack_from("<HI", content)
                    index[number] = np.frombuffer(content, _ENTRY, length // _ENTRY.itemsize, 6)
                    continue
                yield from self._unpacked(chunk, index)
                chunk, index = None, {}
                if kind == _CHUNK:
                    chunk = self._chunk(content)
                elif kind == _MESSAGE:
                    # A file without chunks: each message is a block of its own.
                    yield from self._unpacked(_RECORD.pack(kind, len(content)) + content, {})
                else:
                    self._declare(kind, content)
            yield from self._unpacked(chunk, index)

    def _records(self, file: BinaryIO) -> Iterator[tuple[int, bytes]]:
        """Yield kind and content of the records up to the end of the data.

        What is cut off is left out, but for a chunk, which is yielded as far as it is there.
        """
        size = file.seek(0, io.SEEK_END)
        self.end = file.seek(len(MAGIC))
        while len(header := file.read(_RECORD.size)) == _RECORD.size:
            kind, length = _RECORD.unpack(header)
            if self.end + _RECORD.size + length > size:
                if kind == _CHUNK:
                    yield kind, file.read()
                break
            content = file.read(length)
            self.end += _RECORD.size + length
            yield kind, content
            if kind == _END:
                self._check_close(file, size)
                return
        self.problems.append(f"{self.path.name} was cut off: read as far as it is intact")

    def _check_close(self, file: BinaryIO, size: int) -> None:
        file.seek(size - len(MAGIC))
        if file.read() != MAGIC:
            self.problems.append(f"{self.path.name} was not closed: it has no index")

    def _chunk(self, content: bytes) -> bytes:
        """Return a chunk's records, none where it is damaged."""
        try:
            _, _, size, _ = _CHUNK_HEADER.unpack_from(content)
            place = _CHUNK_HEADER.size
            compression, place = _text(content, place)
            (length,) = struct.unpack_from("<Q", content, place)
            records = content[place + 8 : place + 8 + length]
            if compression == "zstd":
                records = zstd.decompress(records)
            elif compression == "lz4":
                import lz4.frame  # type: ignore[import-untyped]

                records = lz4.frame.decompress(records)
            elif compression:
                raise ValueError(f"compression {compression!r}")
            # A chunk that was cut off and is not compressed has whole messages all the same.
            if len(records) != size and compression:
                raise ValueError(f"{len(records)} bytes in place of {size}")
        except (ValueError, RuntimeError, struct.error, zstd.ZstdError, ImportError) as error:
            self.problems.append(f"{self.path.name}: a chunk cannot be read: {error}")
            return b""
        return records

    def _unpacked(
        self, chunk: bytes | None, index: dict[int, npt.NDArray[np.void]]
    ) -> Iterator[Block]:
        """Yield a chunk's messages by channel."""
        if not chunk:
            return
        found = {number: (entry["time"], entry["offset"]) for number, entry in index.items()}
        if any(number not in self.channels for number in found) or not found:
            found = self._walk(chunk)
        block = np.frombuffer(chunk, np.uint8)
        for number, (times, places) in found.items():
            if not len(times) or number not in self.channels:
                continue
            starts = np.asarray(places, dtype=np.int64)
            if int(starts.max()) + DATA > block.size:
                self.problems.append(f"{self.path.name}: the index of a chunk is wrong")
                continue
            lengths = _little_endian(block, starts + 1, 8)
            ends = starts + _RECORD.size + lengths
            received = np.asarray(times, dtype=np.int64)
            yield Block(self.channels[number], received, block, starts + DATA, ends)

    def _walk(self, chunk: bytes) -> dict[int, tuple[IntArray, IntArray]]:
        """Return times and places of a chunk's messages by channel, declaring what it declares."""
        found: dict[int, list[tuple[int, int]]] = {}
        place = 0
        while place + _RECORD.size <= len(chunk):
            kind, length = _RECORD.unpack_from(chunk, place)
            behind = place + _RECORD.size
            if behind + length > len(chunk):
                break
            if kind == _MESSAGE:
                number, _, time, _ = _MESSAGE_HEADER.unpack_from(chunk, behind)
                found.setdefault(number, []).append((time, place))
            else:
                self._declare(kind, chunk[behind : behind + length])
            place = behind + length
        return {
            number: (
                np.array([time for time, _ in rows], dtype=np.uint64).astype(np.int64),
                np.array([place for _, place in rows], dtype=np.int64),
            )
            for number, rows in found.items()
        }

    def _declare(self, kind: int, content: bytes) -> None:
        """Take note of a schema, a channel or metadata."""
        if kind == _SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            self._schemas[number], _ = _text(content, 2)
        elif kind == _CHANNEL:
            number, schema = struct.unpack_from("<HH", content)
            topic, _ = _text(content, 4)
            self.channels[number] = Channel(topic, self._schemas.get(schema, ""))
        elif kind == _METADATA:
            name, place = _text(content, 0)
            (length,) = struct.unpack_from("<I", content, place)
            place += 4
            end = place + length
            pairs = self.metadata.setdefault(name, {})
            while place < end:
                key, place = _text(content, place)
                pairs[key], place = _text(content, place)


def _text(content: bytes, place: int) -> tuple[str, int]:
    """Return a text with its length before it, and where it ends."""
    (length,) = struct.unpack_from("<I", content, place)
    place += 4
    return content[place : place + length].decode("utf-8", "replace"), place + length


def _little_endian(block: ByteArray, places: IntArray, size: int) -> IntArray:
    """Return the unsigned numbers of so many bytes at some places of a block."""
    gathered: ByteArray = block[places[:, None] + np.arange(size)]
    numbers: IntArray = gathered.view(f"<u{size}")[:, 0].astype(np.int64)
    return numbers
