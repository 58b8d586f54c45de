# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Writer of MCAP files whose chunks are soon on disk and remain readable after a crash.

Each chunk, with messages, index and checksum, is written during the recording. If the disk is
full, the file is closed with the chunks so far. The writer of rosbags keeps all data in memory
until closed, and writes no checksums. The writer of the `mcap` library takes twice as long per
message, and cannot return to a complete chunk.
"""

from __future__ import annotations

import os
import struct
from collections import Counter, defaultdict, deque
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from io import BytesIO
from pathlib import Path
from zlib import crc32

import numpy as np
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinitionFormat

from haptic_accel import __version__
from haptic_accel.bags import mcap
from haptic_accel.bags.compression import zstd
from haptic_accel.bags.mcap import Channel, Chunk, Schema, Tally, record, text, text_map
from haptic_accel.bags.metadata import qos_text
from haptic_accel.core.files import sync_folder

CHUNK = 1 << 20
"""Size of a complete chunk, bytes; 768 KiB in rosbag2."""

KEPT_MARKS = 8
"""Number of chunks that may be discarded to free space for the index, which needs a few percent of
the file size."""

_FAST = 1
"""Fastest compression level (zstd's manual), also used by rosbag2."""

_HEADER = mcap.MESSAGE_HEADER.size
_MESSAGE = struct.Struct("<BQHIQQ")  # headers of a record and of a message, packed together


class MisplacedError(OSError):
    """Error: a file being written is no longer at its path; the message is one line.

    Attributes
    ----------
    is_removed : bool
        True if the file was deleted, and disappears when the program that writes it ends.
    location : Path or None
        Present path of the file, if known.
    """

    def __init__(self, name: str, *, is_removed: bool, location: Path | None = None) -> None:
        what = "removed" if is_removed else "moved away"
        super().__init__(f"{name} was {what} while it was recorded")
        self.is_removed = is_removed
        self.location = location


@dataclass
class _Pending:
    """Records of the next chunk, with times and offsets of the messages by channel."""

    records: BytesIO = field(default_factory=BytesIO)
    entries: defaultdict[int, list[int]] = field(default_factory=lambda: defaultdict(list))


@dataclass(frozen=True)
class _Mark:
    """State of the file after a chunk: length, checksum and contents."""

    end: int
    sum: int
    chunks: int
    tally: Tally


class ChunkedWriter:
    """MCAP file being written; each method may raise OSError.

    Parameters
    ----------
    path : Path
        File to write; its folder exists.
    compressed : bool
        Compress the chunks with zstd.

    Attributes
    ----------
    path : Path
    schemas, channels : list
        Schemas and channels for the index.
    """

    def __init__(self, path: Path, *, compressed: bool = False) -> None:
        self.path = path
        self.schemas: list[Schema] = []
        self.channels: list[Channel] = []
        self._compression = "zstd" if compressed else ""
        self._compress = partial(zstd.compress, level=_FAST) if compressed else bytes
        self._pending = _Pending()
        self._chunks: list[bytes] = []  # records of the chunks for the index
        self._end = self._sum = 0
        self._file = path.open("xb")
        self._append(
            mcap.MAGIC + record(mcap.HEADER, text("ros2"), text(f"haptic_accel-{__version__}"))
        )
        self._file.flush()
        # The duplicate is independent of the file's name and buffer.
        self._descriptor = os.dup(self._file.fileno())
        self._marks = deque([_Mark(self._end, self._sum, 0, Tally())], maxlen=KEPT_MARKS)
        sync_folder(path.parent)

    @property
    def kept(self) -> Tally:
        """Contents of the complete chunks."""
        return self._marks[-1].tally

    @property
    def size(self) -> int:
        """Bytes written and pending."""
        return self._end + self._pending.records.tell()

    def add(self, connection: Connection) -> None:
        """Add a topic with its type's hash, from which rosbag2 rebuilds a bag's metadata."""
        number, kind, topic = connection.id, connection.msgtype, connection.topic
        records = self._pending.records
        if all(schema.name != kind for schema in self.schemas):
            is_msg = connection.msgdef.format == MessageDefinitionFormat.MSG
            encoding = "ros2msg" if is_msg else "ros2idl"
            schema = Schema(len(self.schemas) + 1, kind, encoding, connection.msgdef.data)
            self.schemas.append(schema)
            records.write(_schema_record(schema))
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        offered = qos_text(connection.ext.offered_qos_profiles)
        described = {"offered_qos_profiles": offered, "topic_type_hash": connection.digest}
        form = connection.ext.serialization_format
        self.channels.append(Channel(number, kind, topic, form, text_map(described)))
        records.write(self._channel_record(self.channels[-1]))

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Add a message."""
        records, number = self._pending.records, connection.id
        offset = records.tell()
        self._pending.entries[number].extend((timestamp, offset))
        length = _HEADER + len(data)
        records.write(_MESSAGE.pack(mcap.MESSAGE, length, number, 0, timestamp, timestamp))
        records.write(data)
        if offset > CHUNK:
            self.close_chunk()

    def add_chunk(self, chunk: Chunk) -> None:
        """Add a chunk of another file."""
        self._pending.records.write(chunk.records)
        for number, rows in chunk.entries.items():
            self._pending.entries[number] = np.column_stack(rows).ravel().tolist()
        self.close_chunk()

    def close_chunk(self) -> None:
        """Write pending data to the file.

        Schemas and channels without messages are not written as a chunk: `ros2 bag play` cannot
        sort a file by time if a chunk has no message index.
        """
        records, entries = self._pending.records.getvalue(), self._pending.entries
        if not records:
            return
        tally = self.kept
        if entries:
            counts = Counter({number: len(rows) // 2 for number, rows in entries.items()})
            start = min(min(rows[::2]) for rows in entries.values())
            end = max(max(rows[::2]) for rows in entries.values())
            self._append_chunk(records, entries, start, end)
            tally = tally.plus(counts, start, end)
        else:
            self._append(records)
        self._file.flush()
        self._pending = _Pending()
        self._marks.append(_Mark(self._end, self._sum, len(self._chunks), tally))

    def flush(self) -> None:
        """Complete the pending chunk and sync it to disk, so that it survives a power cut.

        Raises
        ------
        MisplacedError
            The file was removed or moved, or another file has its name.
        """
        self.close_chunk()
        os.fdatasync(self._file.fileno())
        written = os.fstat(self._descriptor)
        try:
            is_there = os.path.samestat(self.path.stat(), written)
        except (FileNotFoundError, NotADirectoryError):
            is_there = False
        if not is_there:
            is_removed, location = written.st_nlink == 0, None
            with suppress(OSError):  # Linux reports an open file's path
                location = Path(f"/proc/self/fd/{self._descriptor}").readlink()
            raise MisplacedError(self.path.name, is_removed=is_removed, location=location)

    def finish(self, metadata: str) -> None:
        """Write pending data, index and end, and sync them to the disk.

        Parameters
        ----------
        metadata : str
            Metadata of the bag, repeated in the file.
        """
        self.close_chunk()
        start = self._end
        repeated = text_map({"serialized_metadata": metadata})
        length = mcap.TEXT_LENGTH.pack(len(repeated))
        self._append(record(mcap.METADATA, text("rosbag2"), length, repeated))
        span = mcap.SPAN.pack(start, self._end - start)
        self._append(record(mcap.DATA_END, mcap.SUM.pack(self._sum)))
        self._append_index(record(mcap.METADATA_INDEX, span, text("rosbag2")))
        self._file.close()
        os.fsync(self._descriptor)
        os.close(self._descriptor)

    def give_up(self, metadata: str) -> None:
        """Finish the file after an OSError with its complete chunks, or fewer to free space.

        Raises
        ------
        OSError
            All complete chunks are saved, but there is no space for an index.
        """
        newest = self._marks[-1]
        while True:
            try:
                self._go_back()
                self.finish(metadata)
                return
            except OSError:
                self._marks.pop()
                if not (self._marks and self.kept.messages):
                    # Keeping all chunks without an index is better than losing data.
                    self._marks.append(newest)
                    self._go_back()
                    self._file.close()
                    raise

    def _append(self, content: bytes) -> None:
        self._sum = crc32(content, self._sum)
        self._end += len(content)
        self._file.write(content)

    def _append_chunk(
        self, records: bytes, entries: dict[int, list[int]], start: int, end: int
    ) -> None:
        """Write a chunk and its message index, and record its position for the file's index."""
        compressed = self._compress(records)
        form = text(self._compression)
        sizes = mcap.CHUNK_HEADER.pack(start, end, len(records), crc32(records))
        header = sizes + form + mcap.LENGTH.pack(len(compressed))
        offset = self._end
        self._append(mcap.RECORD.pack(mcap.CHUNK, len(header) + len(compressed)) + header)
        self._append(compressed)
        length, indexes = self._end - offset, b""
        for number, rows in entries.items():
            indexes += mcap.COUNT.pack(number, self._end)
            index = struct.pack(f"<HI{len(rows)}Q", number, 8 * len(rows), *rows)
            self._append(record(mcap.MESSAGE_INDEX, index))
        self._chunks.append(
            record(
                mcap.CHUNK_INDEX,
                mcap.CHUNK_INDEX_HEADER.pack(start, end, offset, length, len(indexes)),
                indexes,
                mcap.LENGTH.pack(self._end - offset - length),
                form,
                mcap.SPAN.pack(len(compressed), len(records)),
            )
        )

    def _append_index(self, metadata_index: bytes) -> None:
        """Write the index of the file with its checksum, and the end of the file."""
        start, self._sum = self._end, 0
        offsets = b""
        for kind, records in {
            mcap.SCHEMA: [_schema_record(schema) for schema in self.schemas],
            mcap.CHANNEL: [self._channel_record(channel) for channel in self.channels],
            mcap.CHUNK_INDEX: self._chunks,
            mcap.METADATA_INDEX: [metadata_index],
            mcap.STATISTICS: [self._statistics_record()],
        }.items():
            if records:
                offset = self._end
                self._append(b"".join(records))
                span = mcap.SPAN.pack(offset, self._end - offset)
                offsets += record(mcap.SUMMARY_OFFSET, bytes([kind]), span)
        span = mcap.SPAN.pack(start, self._end)
        self._append(offsets)
        self._append(mcap.RECORD.pack(mcap.FOOTER, mcap.SPAN.size + mcap.SUM.size) + span)
        self._append(mcap.SUM.pack(self._sum) + mcap.MAGIC)

    def _channel_record(self, channel: Channel) -> bytes:
        schema = next(schema.id for schema in self.schemas if schema.name == channel.schema)
        return record(
            mcap.CHANNEL,
            struct.pack("<HH", channel.id, schema),
            text(channel.topic),
            text(channel.message_encoding),
            mcap.TEXT_LENGTH.pack(len(channel.metadata)),
            channel.metadata,
        )

    def _statistics_record(self) -> bytes:
        tally = self.kept
        counts = b"".join(
            mcap.COUNT.pack(number, tally.counts[number])
            for number in sorted(channel.id for channel in self.channels)
        )
        header = mcap.STATISTICS_HEADER.pack(
            tally.messages,
            len(self.schemas),
            len(self.channels),
            0,  # attachments
            1,  # metadata
            len(self._chunks),
            tally.start if tally.messages else 0,
            tally.end,
            len(counts),
        )
        return record(mcap.STATISTICS, header, counts)

    def _go_back(self) -> None:
        """Discard everything after the last mark, in the file too."""
        mark = self._marks[-1]
        with suppress(OSError):
            # The file's buffered data must not be written.
            self._file.raw.close()
        os.ftruncate(self._descriptor, mark.end)
        os.lseek(self._descriptor, mark.end, os.SEEK_SET)
        self._file = os.fdopen(os.dup(self._descriptor), "wb")
        self._end, self._sum = mark.end, mark.sum
        del self._chunks[mark.chunks :]
        self._pending = _Pending()


def _schema_record(schema: Schema) -> bytes:
    texts = text(schema.name) + text(schema.encoding) + text(schema.data)
    return record(mcap.SCHEMA, struct.pack("<H", schema.id), texts)
