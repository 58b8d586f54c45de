"""The files of a bag: MCAP and SQLite behind one interface, saved piece by piece.

Built on the writers of rosbags, which know the formats. What is added: data reach the disk
while recording, files are named as rosbag2 names them, and a file that the disk has no more
room for is closed with what is in it.
"""

from __future__ import annotations

import os
import sqlite3
import struct
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Protocol

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.enums import CompressionMode

# The storages of rosbags' Writer: it keeps data until it is closed, they need not.
from rosbags.rosbag2.storage_mcap import Channel, McapWriter, PendingChunk, write_channel
from rosbags.rosbag2.storage_mcap import write_string as write_text
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from haptic_accel.bags.compression import compress_block, sync
from haptic_accel.bags.metadata import NEVER, VERSION, qos_text
from haptic_accel.bags.recording_options import MCAP, SQLITE3, ZSTD_FAST

CHUNK = 1 << 20
"""Size from which a chunk of an MCAP file is complete, bytes; rosbag2 has 768 KiB."""

KEPT_MARKS = 8
"""How many chunks may be given up to make room for the index: some hundred times its size."""

_MESSAGE = struct.Struct("<BQHIQQ")
"""Kind and length of an MCAP record, and what is before a message's data in it."""

_MESSAGE_KIND = 0x05
_MESSAGE_HEADER = struct.calcsize("<HIQQ")


@dataclass
class Tally:
    """What a file holds.

    Attributes
    ----------
    counts : Counter
        Messages by number of their connection.
    start, end : int
        When its first and last message were recorded, system time in ns; `start` is the
        largest such number where there is none, as rosbag2 has it.
    """

    counts: Counter[int] = field(default_factory=Counter)
    start: int = NEVER
    end: int = 0

    @property
    def messages(self) -> int:
        """How many messages."""
        return self.counts.total()

    def copy(self) -> Tally:
        """Return one that goes its own way."""
        return replace(self, counts=self.counts.copy())

    def take(self, counts: Counter[int], start: int, end: int) -> None:
        """Add messages."""
        self.counts.update(counts)
        self.start = min(self.start, start)
        self.end = max(self.end, end)


class Storage(Protocol):
    """A file of a bag that is being written; every method may raise OSError."""

    path: Path

    @property
    def kept(self) -> Tally:
        """What is in the file, up to the last flush."""

    @property
    def size(self) -> int:
        """Bytes written, about."""

    def add(self, connection: Connection) -> None:
        """Add a topic."""

    def write(self, connection: Connection, received: int, data: bytes) -> None:
        """Add a message of a topic that was added."""

    def flush(self) -> None:
        """Bring everything to the disk, where a power cut does not take it away."""

    def close(self, metadata: str) -> None:
        """Bring everything to the disk and finish the file; `metadata` goes into it."""

    def give_up(self, metadata: str) -> None:
        """After an OSError: finish the file as far as it was flushed.

        Raises
        ------
        OSError
            What was flushed is there, but no index and no end.
        """


@dataclass(frozen=True)
class _Mark:
    """An MCAP file after one of its chunks: where it ends, and what it holds."""

    end: int
    chunks: int
    tally: Tally


class ChunkedFile(McapWriter):
    """An MCAP file that remembers what of it is complete."""

    def __init__(self, path: Path, preset: str) -> None:
        fast = preset == ZSTD_FAST
        super().__init__(path.parent, CompressionMode.STORAGE if fast else CompressionMode.NONE)
        if fast:
            self.compressor = compress_block
        # rosbags names the file after the folder, rosbag2 numbers it.
        self.path = self.path.rename(path)
        self.bio.flush()
        # The file itself, whatever becomes of its name and of the buffer before it.
        self._descriptor = os.dup(self.bio.fileno())
        self.marks = deque([_Mark(self.bio.tell(), 0, Tally())], maxlen=KEPT_MARKS)

    @property
    def kept(self) -> Tally:
        """What the complete chunks hold."""
        return self.marks[-1].tally

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic, with its type's hash, from which rosbag2 rebuilds a bag's metadata."""
        metadata = BytesIO()
        for text in (
            "offered_qos_profiles",
            offered_qos_profiles,
            "topic_type_hash",
            connection.digest,
        ):
            write_text(metadata, text)
        assert isinstance(connection.ext, ConnectionExtRosbag2)
        channel = Channel(
            connection.id,
            connection.msgtype,
            connection.topic,
            connection.ext.serialization_format,
            metadata.getvalue(),
        )
        self.channels.append(channel)
        self.channel_stats[connection.id] = 0
        write_channel(self.chunk.bio, channel, self.schemas)

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
        length = _MESSAGE_HEADER + len(data)
        records.write(_MESSAGE.pack(_MESSAGE_KIND, length, number, 0, timestamp, timestamp))
        records.write(data)
        if place > CHUNK:
            self.close_chunk()

    def close_chunk(self) -> None:
        """Write the pending chunk into the file."""
        chunk = self.chunk
        counts = Counter({number: len(rows) for number, rows in chunk.msgs.items()})
        tally = self.kept.copy()
        if counts:
            tally.take(counts, chunk.message_start_time, chunk.message_end_time)
        else:
            chunk.message_start_time = 0  # as the format wants it
        super().close_chunk()
        self.bio.flush()
        self.marks.append(_Mark(self.bio.tell(), len(self.chunks), tally))

    def finish(self, metadata: str) -> None:
        """Write what is pending, index and end, and bring it to the disk."""
        if self.chunk.bio.tell():
            self.close_chunk()
        tally = self.kept
        self.channel_stats.update(tally.counts)
        self.message_start_time = tally.start if tally.messages else 0
        self.message_end_time = tally.end
        super().close(VERSION, metadata)
        os.fsync(self._descriptor)
        os.close(self._descriptor)

    def go_back(self) -> None:
        """Forget whatever came after the last mark, in the file too."""
        mark = self.marks[-1]
        with suppress(OSError):
            # What its buffer holds must not be written any more.
            self.bio.raw.close()
        os.ftruncate(self._descriptor, mark.end)
        os.lseek(self._descriptor, mark.end, os.SEEK_SET)
        self.bio = os.fdopen(os.dup(self._descriptor), "wb")
        del self.chunks[mark.chunks :]
        self.chunk = PendingChunk(NEVER, 0, BytesIO(), defaultdict(list))
        self.channel_stats = dict.fromkeys(self.channel_stats, 0)


class McapStorage:
    """An MCAP file."""

    def __init__(self, path: Path, preset: str) -> None:
        self.path = path
        self._file = ChunkedFile(path, preset)
        self._types: set[str] = set()

    @property
    def kept(self) -> Tally:
        """What is in the file."""
        return self._file.kept

    @property
    def size(self) -> int:
        """Bytes written and pending."""
        return self._file.bio.tell() + self._file.chunk.bio.tell()

    def add(self, connection: Connection) -> None:
        """Add a topic."""
        if connection.msgtype not in self._types:
            self._types.add(connection.msgtype)
            self._file.add_msgtype(connection)
        self._file.add_connection(connection, _offered(connection))

    def write(self, connection: Connection, received: int, data: bytes) -> None:
        """Add a message of a topic that was added."""
        self._file.write(connection, received, data)

    def flush(self) -> None:
        """Finish the pending chunk and bring it to the disk."""
        if self._file.chunk.bio.tell():
            self._file.close_chunk()
        os.fdatasync(self._file.bio.fileno())

    def close(self, metadata: str) -> None:
        """Finish the file with its index."""
        self._file.finish(metadata)

    def give_up(self, metadata: str) -> None:
        """Finish the file with the chunks that are complete, fewer if the index has no room."""
        marks = self._file.marks
        newest = marks[-1]
        while True:
            try:
                self._file.go_back()
                self._file.finish(metadata)
                return
            except OSError:
                marks.pop()
                if not (marks and marks[-1].tally.messages):
                    # Rather all without an index than nothing.
                    marks.append(newest)
                    self._file.go_back()
                    self._file.bio.close()
                    raise


class SqliteStorage:
    """An SQLite file."""

    def __init__(self, path: Path, preset: str) -> None:
        self.path = path
        self.kept = Tally()
        self.size = 0
        self._types: set[str] = set()
        self._pending = Tally()
        with _as_os_error():
            self._file = Sqlite3Writer(path.parent, CompressionMode.NONE)
            # Its journal is named after the file: renamed only while it is closed.
            self._file.conn.close()
            self._file.path = self._file.path.rename(path)
            # Opened here, written by the writer's thread.
            self._file.conn = sqlite3.connect(path, check_same_thread=False)
            self._file.cursor = self._file.conn.cursor()

    def add(self, connection: Connection) -> None:
        """Add a topic."""
        with _as_os_error():
            if connection.msgtype not in self._types:
                self._types.add(connection.msgtype)
                self._file.add_msgtype(connection)
            self._file.add_connection(connection, _offered(connection))

    def write(self, connection: Connection, received: int, data: bytes) -> None:
        """Add a message of a topic that was added."""
        try:
            self._file.write(connection, received, data)
        except sqlite3.Error as error:
            raise OSError(str(error)) from error
        self.size += len(data)
        pending = self._pending
        pending.counts[connection.id] += 1
        pending.start = min(pending.start, received)
        pending.end = max(pending.end, received)

    def flush(self) -> None:
        """Commit, which waits for the disk."""
        with _as_os_error():
            self._file.conn.commit()
        self._keep()

    def close(self, metadata: str) -> None:
        """Commit and finish the file."""
        with _as_os_error():
            self._file.close(VERSION, metadata)
        self._keep()

    def give_up(self, metadata: str) -> None:
        """Leave the file as it was committed last."""
        self._pending = Tally()
        with suppress(sqlite3.Error):
            self._file.abort()

    def _keep(self) -> None:
        self.kept.take(self._pending.counts, self._pending.start, self._pending.end)
        self._pending = Tally()


STORAGES: dict[str, Callable[[Path, str], Storage]] = {
    MCAP: McapStorage,
    SQLITE3: SqliteStorage,
}
SUFFIXES = {MCAP: ".mcap", SQLITE3: ".db3"}


def open_storage(storage: str, path: Path, preset: str) -> Storage:
    """Make a file of a bag.

    Parameters
    ----------
    storage : str
        A key of `STORAGES`.
    path : Path
        The file; its folder exists.
    preset : str
        ``storage_preset_profile`` of the recording.

    Raises
    ------
    OSError
        It cannot be made.
    """
    made = STORAGES[storage](path, preset)
    sync(path.parent)
    return made


def _offered(connection: Connection) -> str:
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    return qos_text(connection.ext.offered_qos_profiles)


@contextmanager
def _as_os_error() -> Iterator[None]:
    """Tell what SQLite complains of as the trouble with a file that it is."""
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(str(error)) from error
