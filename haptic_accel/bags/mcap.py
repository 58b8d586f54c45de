"""Reads an MCAP file by chunks, as far as it is intact.

The readers of `rosbags` and `mcap` give one message at a time, which for ten minutes of this graph
takes a minute or two, and refuse a file that was cut off. Here a chunk's messages stay one block
of bytes with the places of the messages in it.
Format: https://mcap.dev/spec.
"""

from __future__ import annotations

import io
import struct
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt
import yaml

from haptic_accel.bags.rosbags_adapter import DECOMPRESSORS, Channel, Schema, zstd
from haptic_accel.core.sampling import IntArray

ByteArray = npt.NDArray[np.uint8]

MAGIC = b"\x89MCAP0\r\n"
NEVER = 2**63 - 1
"""Start time of a file without messages, ns, as rosbag2 has it."""

LOOSE = 1 << 20
"""Size of the blocks in which records outside chunks are read, bytes."""

# Kinds of records.
_NOTHING, _FOOTER_KIND, _SCHEMA, _CHANNEL, MESSAGE, _CHUNK, _INDEX = 0, 2, 3, 4, 5, 6, 7
_STATISTICS, _METADATA, _DATA_END = 11, 12, 15
_LOOSE_KINDS = (_SCHEMA, _CHANNEL, MESSAGE)
RECORD = struct.Struct("<BQ")  # kind, and length of the content
MESSAGE_HEADER = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK_HEADER = struct.Struct("<QQQI")  # start, end, uncompressed size, CRC
_FOOTER = struct.Struct("<BQQQI8s")  # with its record's header, and the mark at the file's end
# Messages; schemas, channels, attachments, metadata, chunks; start, end, size of the counts.
_STATISTICS_HEADER = struct.Struct("<QHIIIIQQI")
_COUNT = struct.Struct("<HQ")  # channel, messages
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])

DATA = RECORD.size + MESSAGE_HEADER.size
"""Distance of a message's data from the start of its record, bytes."""

Entries = dict[int, tuple[IntArray, IntArray]]
"""Times and places of a chunk's messages, by number of their channel."""

_DAMAGED = (ValueError, RuntimeError, LookupError, struct.error, zstd.ZstdError)


@dataclass
class Tally:
    """Number and times of a file's messages.

    Attributes
    ----------
    counts : Counter
        Messages by number of their channel.
    start, end : int
        Times at which the first and the last message were recorded, system time in ns; `NEVER`
        and 0 without messages.
    """

    counts: Counter[int] = field(default_factory=Counter)
    start: int = NEVER
    end: int = 0

    @property
    def messages(self) -> int:
        """Number of messages."""
        return self.counts.total()

    def plus(self, counts: Counter[int], start: int, end: int) -> Tally:
        """Return the tally with more messages."""
        return Tally(self.counts + counts, min(self.start, start), max(self.end, end))


@dataclass(frozen=True)
class Block:
    """Messages of one channel that lie in one block of bytes.

    Attributes
    ----------
    topic, type : str
        Full name, and type as in ``geometry_msgs/msg/AccelStamped``.
    received : ndarray of int64, shape (n,)
        Times at which they were recorded, system time in ns.
    bytes : ndarray of uint8
        The block.
    starts, ends : ndarray of int64, shape (n,)
        Bounds of each message's data in it.
    """

    topic: str
    type: str
    received: IntArray
    bytes: ByteArray
    starts: IntArray
    ends: IntArray


@dataclass(frozen=True)
class Chunk:
    """Records of a chunk, decompressed and whole, with the places of its messages."""

    records: bytes
    compression: str = ""
    entries: Entries = field(default_factory=dict)


@dataclass
class McapFile:
    """An MCAP file to read: by its index, by chunks, or by blocks of messages.

    Attributes
    ----------
    schemas, channels : dict
        By number, as far as read.
    metadata : dict
        Texts of the metadata records, by record and key.
    problems : list of str
        Damage found while reading, a line each.
    unfinished : str
        How the file ended where it was not closed, in one line; empty where it was.
    """

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    unfinished: str = ""

    @property
    def custom_data(self) -> dict[str, str]:
        """The bag's custom data as a closed file repeats it; empty where there is none."""
        text = self.metadata.get("rosbag2", {}).get("serialized_metadata", "")
        with suppress(yaml.YAMLError, ValueError, TypeError, AttributeError):
            return dict((yaml.safe_load(text) or {}).get("custom_data") or {})
        self.problems.append(f"{self.path.name}: its metadata cannot be read")
        return {}

    def read_index(self) -> Tally:
        """Read schemas, channels and statistics from the index at the file's end.

        Raises
        ------
        ValueError
            There is no index, or it is damaged.
        OSError
            The file cannot be read.
        """
        with self.path.open("rb") as file:
            size = _checked_size(file)
            file.seek(max(0, size - _FOOTER.size))
            kind, _, start, *_, magic = _FOOTER.unpack(file.read().rjust(_FOOTER.size, b"\0"))
            if kind != _FOOTER_KIND or magic != MAGIC or not 0 < start < size:
                raise ValueError("it has no index")
            file.seek(start)
            statistics = b""
            for kind, content in _records(file, size):
                self._declare(kind, content)
                if kind == _STATISTICS:
                    statistics = content
        if self.problems or len(statistics) < _STATISTICS_HEADER.size:
            raise ValueError("its index is damaged")
        return _tally(statistics)

    def blocks(self) -> Iterator[Block]:
        """Yield the messages in the order of the file, a block per chunk and channel.

        Raises
        ------
        ValueError
            It is not an MCAP file.
        OSError
            It cannot be read.
        """
        for chunk in self.chunks():
            block = np.frombuffer(chunk.records, np.uint8)
            for number, (times, starts) in chunk.entries.items():
                if not len(times) or number not in self.channels:
                    continue
                if int(starts.max()) + DATA > block.size:
                    self.problems.append(f"{self.path.name}: the index of a chunk is wrong")
                    continue
                lengths = block[starts[:, None] + np.arange(1, RECORD.size)].view("<u8")[:, 0]
                ends = starts + RECORD.size + lengths.astype(np.int64)
                channel = self.channels[number]
                yield Block(channel.topic, channel.schema, times, block, starts + DATA, ends)

    def chunks(self, *, by_index: bool = True) -> Iterator[Chunk]:
        """Yield the file's chunks; records outside chunks are gathered into some.

        Parameters
        ----------
        by_index : bool
            Take the places of messages from the index behind each chunk, where there is one,
            instead of from the records themselves.

        Raises
        ------
        ValueError, OSError
            As `blocks`.
        """
        with self.path.open("rb") as file:
            size = _checked_size(file)
            chunk, loose, ended = Chunk(b""), bytearray(), False
            for kind, content in _records(file, size):
                if kind == _INDEX:
                    if by_index:
                        chunk.entries.update(_entries(content))
                    continue
                if chunk.records:
                    known = chunk.entries and chunk.entries.keys() <= self.channels.keys()
                    yield chunk if known else self._walked(chunk)
                    chunk = Chunk(b"")
                if kind in _LOOSE_KINDS:
                    loose += RECORD.pack(kind, len(content)) + content
                if loose and (kind not in _LOOSE_KINDS or len(loose) > LOOSE):
                    yield self._walked(Chunk(bytes(loose)))
                    loose.clear()
                if kind == _CHUNK:
                    chunk = self._decompressed(content)
                else:
                    self._declare(kind, content)
                ended = kind == _DATA_END
                if ended:
                    break
            # Behind the last chunk of a file that was cut off, the index may lack channels.
            yield self._walked(chunk)
            yield self._walked(Chunk(bytes(loose)))
            if not ended:
                self.unfinished = f"{self.path.name} was cut off: read as far as it is intact"
            elif not _has_end(file, size):
                self.unfinished = f"{self.path.name} was not closed: it has no index"

    def _decompressed(self, content: bytes) -> Chunk:
        """Return a chunk as far as it is there; without records where it is damaged."""
        record = io.BytesIO(content)
        try:
            _, _, size, _ = _CHUNK_HEADER.unpack(record.read(_CHUNK_HEADER.size))
            compression = _text(record)
            (length,) = struct.unpack("<Q", record.read(8))
            records = DECOMPRESSORS[compression](record.read(min(length, len(content))), size)
            # A chunk that was cut off and is not compressed has whole messages all the same.
            if len(records) != size and (compression or len(records) == length):
                raise ValueError(f"{len(records)} bytes in place of {size}")
        except _DAMAGED as error:
            reason = " ".join(str(error).split())
            self.problems.append(f"{self.path.name}: a chunk cannot be read: {reason}")
            return Chunk(b"")
        return Chunk(records, compression)

    def _walked(self, chunk: Chunk) -> Chunk:
        """Return a chunk cut to its whole records, with the places of its messages.

        Schemas and channels are declared on the way.
        """
        found: dict[int, list[tuple[int, int]]] = {}
        records, place = chunk.records, 0
        while place + RECORD.size <= len(records):
            kind, length = RECORD.unpack_from(records, place)
            start = place + RECORD.size
            if kind == _NOTHING or start + length > len(records):
                break
            if kind == MESSAGE and length >= MESSAGE_HEADER.size:
                number, _, time, _ = MESSAGE_HEADER.unpack_from(records, start)
                found.setdefault(number, []).append((time, place))
            else:
                self._declare(kind, records[start : start + length])
            place = start + length
        entries = {
            number: _pair(np.array(rows, np.uint64).view(_ENTRY)) for number, rows in found.items()
        }
        return Chunk(records[:place], chunk.compression, entries)

    def _declare(self, kind: int, content: bytes) -> None:
        """Take note of a schema, a channel or metadata."""
        record = io.BytesIO(content)
        try:
            if kind == _SCHEMA:
                (number,) = struct.unpack("<H", record.read(2))
                self.schemas[number] = Schema(number, _text(record), _text(record), _text(record))
            elif kind == _CHANNEL:
                number, schema = struct.unpack("<HH", record.read(4))
                name = self.schemas[schema].name if schema in self.schemas else ""
                texts = _text(record), _text(record)
                self.channels[number] = Channel(number, name, *texts, record.read()[4:])
            elif kind == _METADATA:
                self.metadata.setdefault(_text(record), {}).update(text_map(record.read()[4:]))
        except _DAMAGED as error:
            self.problems.append(f"{self.path.name}: a record cannot be read: {error}")


def text_map(content: bytes) -> dict[str, str]:
    """Return a map of texts from a record, without its length."""
    record, texts = io.BytesIO(content), {}
    while record.tell() < len(content):
        name = _text(record)
        texts[name] = _text(record)
    return texts


def _checked_size(file: BinaryIO) -> int:
    """Return a file's size and go behind the mark at its beginning."""
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError("it is not an MCAP file")
    return size


def _has_end(file: BinaryIO, size: int) -> bool:
    file.seek(max(0, size - len(MAGIC)))
    return file.read() == MAGIC


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records that are whole, and of a chunk that is cut off."""
    while len(header := file.read(RECORD.size)) == RECORD.size:
        kind, length = RECORD.unpack(header)
        cut_off = file.tell() + length > size
        # Where power was cut, a file may end in zeros.
        if kind == _NOTHING or (cut_off and kind != _CHUNK):
            return
        yield kind, file.read(min(length, size))


def _tally(statistics: bytes) -> Tally:
    """Return the number and times of messages in a statistics record."""
    messages, *_, start, end, size = _STATISTICS_HEADER.unpack_from(statistics)
    counts = Counter(dict(_COUNT.iter_unpack(statistics[_STATISTICS_HEADER.size :][:size])))
    return Tally(counts, start, end) if messages else Tally()


def _entries(index: bytes) -> Entries:
    """Return the places of one channel's messages in a message index record."""
    number, length = struct.unpack_from("<HI", index)
    return {number: _pair(np.frombuffer(index, _ENTRY, length // _ENTRY.itemsize, 6))}


def _pair(entries: npt.NDArray[np.void]) -> tuple[IntArray, IntArray]:
    flat = entries.reshape(-1)
    return flat["time"].astype(np.int64), flat["offset"].astype(np.int64)


def _text(record: BinaryIO) -> str:
    """Return a text with its length before it."""
    (length,) = struct.unpack("<I", record.read(4))
    return record.read(length).decode("utf-8", "replace")
