# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Records of MCAP files, and their reader by chunks, which keeps the intact parts of damaged ones.

Format: https://mcap.dev/spec.

The readers of `rosbags` and `mcap` reject truncated files, and return one message at a time, which
takes one to two minutes for ten minutes of this graph. Here the messages of a chunk remain one
block of bytes with an array of offsets. Data with a wrong checksum are skipped.
"""

from __future__ import annotations

import io
import itertools
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple
from zlib import crc32

import numpy as np
import numpy.typing as npt
from lz4 import frame as lz4  # type: ignore[import-untyped]

from haptic_accel.bags.compression import LARGEST_FILE, LARGEST_RECORD, Allowance, zstd
from haptic_accel.core.document import load_yaml, texts_of
from haptic_accel.core.files import opened
from haptic_accel.core.sampling import IntArray

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


ByteArray = npt.NDArray[np.uint8]

LOOSE = 1 << 20
"""Size of the blocks for reading records outside chunks, bytes."""

MOST_INDEXED = 500_000
"""Maximum number of records in an index; rosbag2 writes one per chunk and a few more."""

MOST_PROBLEMS = 100
"""Maximum number of reported problems of a file."""

_LOOSE_KINDS = (SCHEMA, CHANNEL, MESSAGE)
_READ_KINDS = (*_LOOSE_KINDS, CHUNK, MESSAGE_INDEX, METADATA, DATA_END)
# Kind of an index record, offset of position and length in it, and kind of the indexed record.
_SPANS = ((CHUNK_INDEX, 16, CHUNK), (METADATA_INDEX, 0, METADATA))
_UNKNOWN = -1
"""Invalid channel id; such chunks are scanned."""

_FOOTER = struct.Struct("<BQQQI8s")  # with the record's header and the file's end mark
_DATA_END = struct.Struct("<BQI")  # with the record's header
_ENTRY = np.dtype([("time", "<u8"), ("offset", "<u8")])
# Record of a message up to its data: RECORD and MESSAGE_HEADER as a numpy type.
_HEAD = np.dtype(
    {
        "names": ["kind", "length", "channel", "sequence", "time", "publish_time"],
        "formats": ["u1", "<u8", "<u2", "<u4", "<u8", "<u8"],
    }
)

_DECOMPRESSORS = {"lz4": lz4.LZ4FrameDecompressor, "zstd": zstd.ZstdDecompressor}

DATA = _HEAD.itemsize
"""Offset of a message's data from the start of its record, bytes."""

Entries = dict[int, tuple[IntArray, IntArray]]
"""Times and offsets of a chunk's messages, by channel id."""

DAMAGE_ERRORS = (
    *(ValueError, TypeError, AttributeError, LookupError, OverflowError),
    *(RuntimeError, EOFError, struct.error, zstd.ZstdError),
)
"""Errors raised by readers for damaged content."""


@dataclass(frozen=True)
class Block:
    """Messages of one channel in one block of bytes.

    Attributes
    ----------
    topic, type : str
        Full name, and type, for example ``geometry_msgs/msg/AccelStamped``.
    received : ndarray of int64, shape (n,)
        Recording times, system time in ns.
    bytes : ndarray of uint8
        Bytes of the block.
    starts, ends : ndarray of int64, shape (n,)
        Start and end of each message in `bytes`.
    offsets : ndarray of int64, shape (n,)
        Positions of the messages in the file's order; unique in the file.
    """

    topic: str
    type: str
    received: IntArray
    bytes: ByteArray
    starts: IntArray
    ends: IntArray
    offsets: IntArray


@dataclass(frozen=True)
class Chunk:
    """Records of a chunk, decompressed and complete, with the offsets of its messages."""

    records: bytes
    compression: str = ""
    entries: Entries = field(default_factory=dict)


@dataclass(frozen=True)
class _Index:
    """Index at the end of a file.

    Attributes
    ----------
    start : int
        Position in the file.
    records : list
        Kind and content of each index record.
    spans : list
        Position, length and kind of the file's chunks and metadata, if it has chunks.
    tally : Tally
    """

    start: int
    records: list[tuple[int, bytes]]
    spans: list[tuple[int, int, int]]
    tally: Tally


@dataclass
class McapFile:
    """MCAP file, readable by its index, by chunks, or by blocks of messages.

    Attributes
    ----------
    schemas, channels : dict
        Items read so far, by number.
    metadata : dict
        Texts of the metadata records, by record and key.
    problems : list of str
        Damage found during reading, one line each.
    unfinished : str
        Message about the end of a file that was not closed; empty if it was closed.
    """

    path: Path
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    unfinished: str = ""
    _allowance: Allowance = field(init=False, repr=False)

    @property
    def custom_data(self) -> dict[str, str]:
        """Custom data of the bag, repeated in a closed file; empty if there are none."""
        repeated = self.metadata.get("rosbag2", {}).get("serialized_metadata", "")
        try:
            return texts_of((load_yaml(repeated) or {}).get("custom_data"))
        except DAMAGE_ERRORS:
            self._report("its metadata cannot be read")
            return {}

    def read_index(self) -> Tally:
        """Read schemas, channels and statistics from the index at the end of the file.

        Raises
        ------
        ValueError
            The index is missing or damaged, or contains a chunk without messages.
        OSError
            The file cannot be read.
        """
        with opened(self.path, LARGEST_FILE) as file:
            index = _index(file, _checked_size(file))
        for kind, content in index.records:
            self._declare(kind, content)
        if self.problems:
            raise ValueError("its index is damaged")
        chunks = [content for kind, content in index.records if kind == CHUNK_INDEX]
        # The last number of an index is that of the channels with messages.
        if not all(CHUNK_INDEX_HEADER.unpack_from(chunk)[-1] for chunk in chunks):
            raise ValueError(
                "a chunk has no index of messages, so that ros2 bag play plays nothing"
            )
        return index.tally

    def blocks(self) -> Iterator[Block]:
        """Yield the messages in file order, as one block per chunk and channel.

        Raises
        ------
        ValueError
            The file is not an MCAP file, or exceeds the limit of expansion.
        OSError
            The file cannot be read.
        """
        before = 0
        for chunk in self.chunks():
            block = np.frombuffer(chunk.records, np.uint8)
            for number, (times, starts) in chunk.entries.items():
                if not len(times) or number not in self.channels:
                    continue
                ends = starts + _sizes(chunk.records, starts)
                channel = self.channels[number]
                offsets = before + starts
                starts = starts + DATA
                yield Block(channel.topic, channel.schema, times, block, starts, ends, offsets)
            before += len(chunk.records)

    def chunks(self, *, by_index: bool = True) -> Iterator[Chunk]:
        """Yield the file's chunks; records outside chunks are collected in chunks.

        Parameters
        ----------
        by_index : bool
            Use the message index after each chunk, if it exists and is intact, instead of scanning
            the records.

        Raises
        ------
        ValueError, OSError
            See `blocks` for the conditions.
        """
        self._allowance = Allowance(self.path)
        with opened(self.path, LARGEST_FILE) as file:
            size = _checked_size(file)
            index = self._intact_index(file, size)
            is_intact = not index or _data_are_intact(file, index.start)
            file.seek(len(MAGIC))
            records = self._records(file, size)
            if index and index.spans and not is_intact:
                # A damaged record length hides later records from a scan, but not from the index.
                for kind, content in index.records:
                    self._declare(kind, content)
                records = self._records_at(file, size, index.spans)
            yield from self._gathered(records, by_index=by_index and is_intact)
            if not is_intact and not self.problems:
                self._report("differs from its checksum, but in no message")

    def _report(self, problem: object) -> None:
        line = f"{self.path.name}: {' '.join(str(problem).split())}"
        if len(self.problems) < MOST_PROBLEMS and line not in self.problems:
            self.problems.append(line)

    def _intact_index(self, file: BinaryIO, size: int) -> _Index | None:
        """Return the index; None if it is missing or damaged, which is reported."""
        try:
            return _index(file, size)
        except DamagedIndexError as error:
            self._report(error)
        except ValueError as error:
            self.unfinished = f"{self.path.name} {error}"
        return None

    def _records(self, file: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
        """Yield the complete records, and a truncated chunk."""
        while len(header := file.read(RECORD.size)) == RECORD.size:
            kind, length = RECORD.unpack(header)
            offset = file.tell()
            is_cut_off = offset + length > size
            # After a power cut, the end of a file may be zeros.
            if kind == NOTHING or (is_cut_off and kind != CHUNK):
                return
            length = min(length, size - offset)
            if kind in _READ_KINDS and length <= LARGEST_RECORD:
                yield kind, file.read(length)
                continue
            if kind in _READ_KINDS:
                self._report(
                    f"a record has {length} bytes and is left out; at most {LARGEST_RECORD} are"
                    " allowed"
                )
            file.seek(offset + length)

    def _records_at(
        self, file: BinaryIO, size: int, spans: list[tuple[int, int, int]]
    ) -> Iterator[tuple[int, bytes]]:
        """Yield the records at the index's positions, then an end record."""
        for offset, length, kind in spans:
            if length > LARGEST_RECORD or offset + length > size:
                self._report(f"a record of {length} bytes is not where the index has it")
                continue
            self._allowance.spend(length)  # the index may repeat a position many times
            file.seek(offset)
            yield kind, file.read(length)[RECORD.size :]
        yield DATA_END, b""

    def _gathered(
        self, records: Iterator[tuple[int, bytes]], *, by_index: bool
    ) -> Iterator[Chunk]:
        """Yield chunks from the records of a file."""
        chunk, loose, ended = Chunk(b""), bytearray(), False
        for kind, content in records:
            if kind == MESSAGE_INDEX:
                if by_index:
                    chunk.entries.update(_entries(content))
                continue
            if chunk.records:
                yield self._placed(chunk)
                chunk = Chunk(b"")
            if kind in _LOOSE_KINDS and self._declare(kind, content):
                loose += record(kind, content)
            if loose and (kind not in _LOOSE_KINDS or len(loose) > LOOSE):
                yield self._walked(Chunk(bytes(loose)))
                loose.clear()
            if kind == CHUNK:
                chunk = self._decompressed(content)
            elif kind == METADATA:
                self._declare(kind, content)
            ended = kind == DATA_END
            if ended:
                break
        # After the last chunk of a truncated file, channels may be missing in the index.
        yield self._walked(chunk)
        yield self._walked(Chunk(bytes(loose)))
        if not ended:
            self.unfinished = f"{self.path.name} was cut off: read as far as it is intact"

    def _decompressed(self, content: bytes) -> Chunk:
        """Return the available part of a chunk; a damaged chunk has no records."""
        stream, span = io.BytesIO(content), ""
        try:
            start, end, size, checksum = CHUNK_HEADER.unpack(stream.read(CHUNK_HEADER.size))
            span = f", messages from {_moment(start)} to {_moment(end)} are left out"
            compression = read_text(stream)
            (length,) = LENGTH.unpack(stream.read(LENGTH.size))
            if size > LARGEST_RECORD:
                raise ValueError(f"it states {size} bytes; at most {LARGEST_RECORD} are allowed")
            stored = stream.read()
            records = stored[:length]
            if compression:
                decompressor = _DECOMPRESSORS[compression]()
                records = bytes(decompressor.decompress(records, max_length=size))
            # A truncated chunk without compression still contains complete messages.
            if len(records) != size and (compression or len(stored) >= length):
                raise ValueError(f"{len(records)} bytes in place of {size}")
            if len(records) == size and checksum and crc32(records) != checksum:
                raise ValueError("it differs from its checksum")
        except DAMAGE_ERRORS as error:
            self._report(f"a chunk cannot be read: {error}{span}")
            return Chunk(b"")
        if compression:
            self._allowance.spend(len(records))
        return Chunk(records, compression)

    def _placed(self, chunk: Chunk) -> Chunk:
        """Return a chunk with its messages' offsets, from the message index if it is correct."""
        entries = chunk.entries
        if not entries or not entries.keys() <= self.channels.keys():
            return self._walked(chunk)
        if not all(_is_right(chunk.records, number, *rows) for number, rows in entries.items()):
            self._report("the index of a chunk is wrong")
            return self._walked(chunk)
        # Records before a message may declare topics of messages in later chunks.
        starts = np.concatenate([starts for _, starts in entries.values()])
        is_all = len(starts) and _sizes(chunk.records, starts).sum() == len(chunk.records)
        return chunk if is_all else self._walked(chunk)

    def _walked(self, chunk: Chunk) -> Chunk:
        """Return a chunk, cut to its valid records, with the offsets of its messages.

        Schemas and channels are declared during the scan.
        """
        found: dict[int, list[tuple[int, int]]] = {}
        records, offset = chunk.records, 0
        parts, begin, removed = [], 0, 0
        while offset + RECORD.size <= len(records):
            kind, length = RECORD.unpack_from(records, offset)
            start = offset + RECORD.size
            end = start + length
            if kind == NOTHING or end > len(records):
                break
            if kind == MESSAGE and length >= MESSAGE_HEADER.size:
                number, _, time, _ = MESSAGE_HEADER.unpack_from(records, start)
                is_sound = time <= NEVER
                if is_sound:
                    found.setdefault(number, []).append((time, offset - removed))
            else:
                is_sound = kind != MESSAGE and self._declare(kind, records[start:end])
            if kind == MESSAGE and not is_sound:
                self._report("a message is too short, or has an impossible time: it is left out")
            if not is_sound:
                parts.append(records[begin:offset])
                removed += end - offset
                begin = end
            offset = end
        entries = {
            number: _pair(np.array(rows, np.uint64).view(_ENTRY)) for number, rows in found.items()
        }
        whole = b"".join((*parts, records[begin:offset]))
        return Chunk(whole, chunk.compression, entries)

    def _declare(self, kind: int, content: bytes) -> bool:
        """Declare a schema, a channel or metadata; return whether it could be read."""
        stream = io.BytesIO(content)
        read = read_text
        try:
            if kind == SCHEMA:
                (number,) = struct.unpack("<H", stream.read(2))
                self.schemas[number] = Schema(number, read(stream), read(stream), read(stream))
            elif kind == CHANNEL:
                number, schema = struct.unpack("<HH", stream.read(4))
                name = self.schemas[schema].name if schema in self.schemas else ""
                texts = read(stream), read(stream)
                self.channels[number] = Channel(number, name, *texts, stream.read()[4:])
            elif kind == METADATA:
                name = read(stream)
                self.metadata[name] = read_text_map(stream.read()[4:])
        except DAMAGE_ERRORS as error:
            self._report(f"a record cannot be read: {error}")
            return False
        return True


class DamagedIndexError(ValueError):
    """Error: the index of a closed file cannot be read; the message is one line."""


def _checked_size(file: BinaryIO) -> int:
    """Return a file's size and skip the mark at its beginning."""
    size = file.seek(0, io.SEEK_END)
    file.seek(0)
    if file.read(len(MAGIC)) != MAGIC:
        raise ValueError("it is not an MCAP file")
    return size


def _index(file: BinaryIO, size: int) -> _Index:
    """Return the index.

    Raises
    ------
    DamagedIndexError
        The index is damaged.
    ValueError
        There is no index.
    """
    file.seek(max(0, size - _FOOTER.size))
    footer = file.read().rjust(_FOOTER.size, b"\0")
    kind, length, start, _, checksum, mark = _FOOTER.unpack(footer)
    if mark != MAGIC or not start:
        raise ValueError("was not closed: index missing")
    end = size - _FOOTER.size
    is_footer = (kind, length) == (FOOTER, SPAN.size + SUM.size)
    if not (is_footer and len(MAGIC) + _DATA_END.size <= start <= end < start + LARGEST_RECORD):
        raise DamagedIndexError("its index is damaged")
    file.seek(start)
    content = file.read(end - start)
    # The checksum includes the part of the footer before it.
    if checksum and crc32(footer[: -len(MAGIC) - SUM.size], crc32(content)) != checksum:
        raise DamagedIndexError("its index is damaged: it differs from its checksum")
    try:
        records = list(itertools.islice(_index_records(content), MOST_INDEXED + 1))
        if len(records) > MOST_INDEXED:
            raise ValueError(f"it has more than {MOST_INDEXED} records")
        spans = [
            (*SPAN.unpack_from(content, offset), kind)
            for found, content in records
            for known, offset, kind in _SPANS
            if found == known
        ]
        (tally,) = (_tally(content) for kind, content in records if kind == STATISTICS)
    except DAMAGE_ERRORS as error:
        raise DamagedIndexError(f"its index is damaged: {error}") from None
    has_chunks = any(kind == CHUNK for *_, kind in spans)
    return _Index(start, records, sorted(spans) if has_chunks else [], tally)


def _index_records(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of the records in an index."""
    offset = 0
    while offset < len(content):
        kind, length = RECORD.unpack_from(content, offset)
        offset += RECORD.size
        yield kind, content[offset : offset + length]
        offset += length


def _data_are_intact(file: BinaryIO, end: int) -> bool:
    """Return whether the data before an index match their checksum, if any."""
    left = end - _DATA_END.size
    file.seek(left)
    kind, length, checksum = _DATA_END.unpack(file.read(_DATA_END.size))
    if (kind, length) != (DATA_END, SUM.size):
        return False
    file.seek(0)
    found = 0
    while checksum and left:
        found = crc32(part := file.read(min(left, LOOSE)), found)
        left -= len(part)
    return bool(found == checksum)


def _tally(statistics: bytes) -> Tally:
    """Return the number and times of messages from a statistics record."""
    messages, *_, start, end, size = STATISTICS_HEADER.unpack_from(statistics)
    counts = statistics[STATISTICS_HEADER.size :][:size]
    if max(start, end) > NEVER:
        raise ValueError("it has impossible times")
    return Tally(Counter(dict(COUNT.iter_unpack(counts))), start, end) if messages else Tally()


def _entries(index: bytes) -> Entries:
    """Return the offsets of one channel's messages from a message index record."""
    try:
        number, length = struct.unpack_from("<HI", index)
        return {number: _pair(np.frombuffer(index, _ENTRY, length // _ENTRY.itemsize, 6))}
    except DAMAGE_ERRORS:
        return {_UNKNOWN: _pair(np.empty(0, _ENTRY))}


def _pair(entries: npt.NDArray[np.void]) -> tuple[IntArray, IntArray]:
    flat = entries.reshape(-1)
    return flat["time"].astype(np.int64), flat["offset"].astype(np.int64)


def _is_right(records: bytes, number: int, times: IntArray, starts: IntArray) -> bool:
    """Return whether the offsets of a channel's messages are correct."""
    if not len(starts):
        return True
    if int(starts.min()) < 0 or int(starts.max()) + DATA > len(records):
        return False
    heads = _heads(records, starts)
    lengths = heads["length"].astype(np.int64)
    is_message = (heads["kind"] == MESSAGE) & (heads["channel"] == number)
    is_timed = (heads["time"].astype(np.int64) == times) & (times >= 0)
    is_whole = (lengths >= MESSAGE_HEADER.size) & (lengths <= len(records) - RECORD.size - starts)
    return bool((is_message & is_timed & is_whole).all())


def _heads(records: bytes, starts: IntArray) -> npt.NDArray[np.void]:
    """Return the headers before the data of messages."""
    anywhere = np.ndarray((len(records) - DATA + 1,), _HEAD, records, strides=(1,))
    return anywhere[starts]


def _sizes(records: bytes, starts: IntArray) -> IntArray:
    """Return the sizes of messages, with the headers of their records, bytes."""
    return _heads(records, starts)["length"].astype(np.int64) + RECORD.size


def _moment(nanoseconds: int) -> str:
    return f"{np.datetime64(min(nanoseconds, NEVER), 'ns').astype('datetime64[ms]')}Z"
