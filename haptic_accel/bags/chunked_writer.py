"""Writes one MCAP file so that every chunk is on the disk soon and stays readable.

Built on the writer of rosbags, which knows the format. Added: chunks reach the disk while
recording, the file is named as rosbag2 names it, and a file that the disk has no more room for is
closed with what is in it. The writer of the `mcap` library takes twice as long for a message and
cannot go back to a chunk that was whole.
"""

from __future__ import annotations

import os
import struct
from collections import Counter, defaultdict, deque
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2 import CompressionMode

from haptic_accel.bags import rosbags_adapter as rosbags
from haptic_accel.bags.mcap import MESSAGE, MESSAGE_HEADER, NEVER, Chunk, Tally
from haptic_accel.bags.metadata import VERSION, qos_text

CHUNK = 1 << 20
"""Size at which a chunk is complete, bytes; rosbag2 has 768 KiB."""

KEPT_MARKS = 8
"""Number of chunks that may be given up for the index, which takes some hundredth of the room."""

_FAST = 1
"""Compression level that costs least time (zstd's manual); rosbag2 has the same."""

_HEADER = MESSAGE_HEADER.size
_MESSAGE = struct.Struct("<BQHIQQ")  # a record's header and a message's, packed at once


@dataclass(frozen=True)
class _Mark:
    """State of the file after one of its chunks: its length, and what it holds."""

    end: int
    chunks: int
    tally: Tally


class ChunkedWriter(rosbags.McapWriter):
    """An MCAP file that is written; every method may raise OSError.

    Parameters
    ----------
    path : Path
        The file; its folder exists.
    compressed : bool
        Compress the chunks with zstd.

    Attributes
    ----------
    path : Path
    """

    def __init__(self, path: Path, *, compressed: bool = False) -> None:
        mode = CompressionMode.STORAGE if compressed else CompressionMode.NONE
        super().__init__(path.parent, mode)
        if compressed:
            self.compressor = lambda data: rosbags.zstd.compress(data, level=_FAST)
        # rosbags names the file after the folder, rosbag2 numbers it.
        self.path = self.path.rename(path)
        self.bio.flush()
        # The file itself, whatever becomes of its name and of the buffer before it.
        self._descriptor = os.dup(self.bio.fileno())
        self._marks = deque([_Mark(self.bio.tell(), 0, Tally())], maxlen=KEPT_MARKS)
        _sync_folder(path.parent)

    @property
    def kept(self) -> Tally:
        """Content of the complete chunks."""
        return self._marks[-1].tally

    @property
    def size(self) -> int:
        """Bytes written and pending."""
        return self.bio.tell() + self.chunk.bio.tell()

    def add(self, connection: Connection) -> None:
        """Add a topic, with its type's hash, from which rosbag2 rebuilds a bag's metadata."""
        if all(schema.name != connection.msgtype for schema in self.schemas):
            self.add_msgtype(connection)
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        metadata, offered = BytesIO(), qos_text(connection.ext.offered_qos_profiles)
        for text in ("offered_qos_profiles", offered, "topic_type_hash", connection.digest):
            rosbags.write_string(metadata, text)
        number, kind, topic = connection.id, connection.msgtype, connection.topic
        form = connection.ext.serialization_format
        channel = rosbags.Channel(number, kind, topic, form, metadata.getvalue())
        self.channels.append(channel)
        rosbags.write_channel(self.chunk.bio, channel, self.schemas)

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Add a message: rosbags' own takes three times as long, for each of a thousand a ms."""
        chunk, number = self.chunk, connection.id
        records = chunk.bio
        if timestamp < chunk.message_start_time:
            chunk.message_start_time = timestamp
        if timestamp > chunk.message_end_time:
            chunk.message_end_time = timestamp
        place = records.tell()
        chunk.msgs[number].append((timestamp, place))
        length = _HEADER + len(data)
        records.write(_MESSAGE.pack(MESSAGE, length, number, 0, timestamp, timestamp))
        records.write(data)
        if place > CHUNK:
            self.close_chunk()

    def take(self, chunk: Chunk) -> None:
        """Add a chunk of another file."""
        pending = _empty_chunk()
        pending.bio.write(chunk.records)
        for number, (times, places) in chunk.entries.items():
            pending.msgs[number] = list(zip(times.tolist(), places.tolist(), strict=True))
            pending.message_start_time = min(pending.message_start_time, int(times.min()))
            pending.message_end_time = max(pending.message_end_time, int(times.max()))
        self.chunk = pending
        self.close_chunk()

    def close_chunk(self) -> None:
        """Write the pending chunk, if there is any, into the file."""
        chunk = self.chunk
        if not chunk.bio.tell():
            return
        counts = Counter({number: len(rows) for number, rows in chunk.msgs.items()})
        tally = self.kept.plus(counts, chunk.message_start_time, chunk.message_end_time)
        if not counts:
            chunk.message_start_time = 0  # as the format wants it
        super().close_chunk()
        self.bio.flush()
        self._marks.append(_Mark(self.bio.tell(), len(self.chunks), tally))

    def flush(self) -> None:
        """Finish the pending chunk and bring it to the disk, where a power cut leaves it."""
        self.close_chunk()
        os.fdatasync(self.bio.fileno())

    def finish(self, metadata: str) -> None:
        """Write what is pending, index and end, and bring it to the disk.

        Parameters
        ----------
        metadata : str
            The bag's metadata, repeated in the file.
        """
        self.close_chunk()
        tally = self.kept
        self.channel_stats = {channel.id: tally.counts[channel.id] for channel in self.channels}
        self.message_start_time = tally.start if tally.messages else 0
        self.message_end_time = tally.end
        self.close(VERSION, metadata)
        os.fsync(self._descriptor)
        os.close(self._descriptor)

    def give_up(self, metadata: str) -> None:
        """After an OSError: finish the file with its complete chunks, fewer if the index needs it.

        Raises
        ------
        OSError
            All complete chunks are there, but there is no room for an index.
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
                    # Rather all without an index than nothing.
                    self._marks.append(newest)
                    self._go_back()
                    self.bio.close()
                    raise

    def _go_back(self) -> None:
        """Forget whatever came after the last mark, in the file too."""
        mark = self._marks[-1]
        with suppress(OSError):
            # What its buffer holds must not be written any more.
            self.bio.raw.close()
        os.ftruncate(self._descriptor, mark.end)
        os.lseek(self._descriptor, mark.end, os.SEEK_SET)
        self.bio = os.fdopen(os.dup(self._descriptor), "wb")
        del self.chunks[mark.chunks :]
        self.chunk = _empty_chunk()


def _empty_chunk() -> rosbags.PendingChunk:
    return rosbags.PendingChunk(NEVER, 0, BytesIO(), defaultdict(list))


def _sync_folder(path: Path) -> None:
    """Bring the names in a folder to the disk."""
    number = os.open(path, os.O_RDONLY)
    try:
        os.fsync(number)
    finally:
        os.close(number)
