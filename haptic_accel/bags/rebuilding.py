"""Rebuilds files of bags that were not closed, from what of them is intact."""

from __future__ import annotations

import sqlite3
import struct
from collections import defaultdict
from collections.abc import Iterator
from contextlib import closing, suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

import yaml
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, Channel, PendingChunk, Schema

from haptic_accel.bags.inspection import JOURNAL, DamagedError, channel_entry
from haptic_accel.bags.mcap import MAGIC, McapFile
from haptic_accel.bags.metadata import NEVER, FileEntry, Metadata
from haptic_accel.bags.recording_options import MCAP, NONE, ZSTD_FAST
from haptic_accel.bags.storage import CHUNK, ChunkedFile, SqliteStorage

# Kinds of MCAP records (https://mcap.dev/spec).
_NOTHING, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0, 3, 4, 5, 6, 15
_RECORD = struct.Struct("<BQ")  # kind and length of what follows
_MESSAGE_START = struct.Struct("<HIQ")  # channel, sequence, log time
_CHUNK_START = struct.Struct("<QQQII")  # start, end, size, CRC, length of the next text
_ZSTD = "zstd"

# Of an SQLite file's header (https://sqlite.org/fileformat.html): its length, and where the size
# of a page and their number are; 1 stands for the largest page.
_SQLITE_HEADER, _PAGE_SIZE, _PAGES = 100, 16, 28
_LARGEST_PAGE = 1 << 16


class _Record(NamedTuple):
    kind: int
    content: bytes
    whole: bool


class _Rebuilt(ChunkedFile):
    """An MCAP file that takes chunks of another."""

    def take(self, records: bytes) -> None:
        """Add a chunk with all records of it that are whole."""
        chunk = PendingChunk(NEVER, 0, BytesIO(), defaultdict(list))
        place = 0
        for kind, start, end in _walk(records):
            if kind == _MESSAGE:
                number, _, time = _MESSAGE_START.unpack_from(records, start)
                chunk.msgs[number].append((time, place))
                chunk.message_start_time = min(chunk.message_start_time, time)
                chunk.message_end_time = max(chunk.message_end_time, time)
            else:
                self._declare(kind, records[start:end])
            place = end
        if place:
            chunk.bio.write(records[:place])
            self.chunk = chunk
            self.close_chunk()

    def finish_as(self, name: str, custom: dict[str, str]) -> None:
        """Write index and end; the file says what it is."""
        tally = self.kept
        topics = tuple(channel_entry(c, tally.counts[c.id]) for c in self.channels)
        entry = FileEntry(name, tally.start, tally.end, tally.messages)
        self.finish(Metadata(MCAP, (entry,), topics, custom=custom).text)

    def _declare(self, kind: int, content: bytes) -> None:
        """Note a schema or a channel for the index."""
        if kind == _SCHEMA:
            (number,) = struct.unpack_from("<H", content)
            if all(schema.id != number for schema in self.schemas):
                name, encoding, data = _texts(content, 2, 3)
                self.schemas.append(Schema(number, name, encoding, data))
        elif kind == _CHANNEL:
            number, schema_number = struct.unpack_from("<HH", content)
            schema = next((s.name for s in self.schemas if s.id == schema_number), "")
            if schema and all(channel.id != number for channel in self.channels):
                topic, encoding = _texts(content, 4, 2)
                start = 4 + 4 + len(topic.encode()) + 4 + len(encoding.encode()) + 4
                self.channels.append(Channel(number, schema, topic, encoding, content[start:]))
                self.channel_stats[number] = 0


def rebuild_mcap(damaged: Path, target: Path, custom: dict[str, str]) -> list[str]:
    """Write what is intact of an MCAP file into another, with an index.

    Chunks stay as they are. Of a last one that was cut off, and is not compressed, the messages
    that are whole are kept.

    Parameters
    ----------
    damaged, target : Path
        The second is made.
    custom : dict
        What the bag says of itself, kept in the file.

    Returns
    -------
    list of str
        What could not be kept, a line each.

    Raises
    ------
    DamagedError
        It is no MCAP file at all.
    OSError
        The other cannot be written.
    """
    problems: list[str] = []
    with damaged.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise DamagedError(f"{damaged.name}: is no MCAP file")
        rebuilt: _Rebuilt | None = None
        loose = BytesIO()  # records outside of chunks, as some writers have them
        for record in _records(file):
            if record.kind == _CHUNK:
                compression, records, problem = _unpacked(record)
                if problem:
                    problems.append(f"{damaged.name}: a chunk cannot be read: {problem}")
                preset = ZSTD_FAST if compression == _ZSTD else NONE
                rebuilt = rebuilt or _Rebuilt(target, preset)
                rebuilt.take(records)
            elif record.whole and record.kind in (_SCHEMA, _CHANNEL, _MESSAGE):
                loose.write(_RECORD.pack(record.kind, len(record.content)) + record.content)
                if loose.tell() > CHUNK:
                    rebuilt = rebuilt or _Rebuilt(target, NONE)
                    rebuilt.take(loose.getvalue())
                    loose = BytesIO()
        rebuilt = rebuilt or _Rebuilt(target, NONE)
        rebuilt.take(loose.getvalue())
        rebuilt.finish_as(damaged.name, custom)
    return problems


def custom_data_of(path: Path) -> dict[str, str]:
    """Return what a closed MCAP file says of its bag; nothing where it says nothing."""
    file = McapFile(path)
    with suppress(OSError, ValueError, struct.error, yaml.YAMLError):
        for _ in file.blocks():
            pass
        text = file.metadata.get("rosbag2", {}).get("serialized_metadata", "")
        return dict((yaml.safe_load(text) or {}).get("custom_data") or {})
    return {}


def undo_transaction(path: Path) -> None:
    """Let SQLite undo what of a file was not committed.

    Raises
    ------
    DamagedError
        It is no SQLite file, or damaged.
    """
    try:
        with closing(sqlite3.connect(path)) as connection:
            (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.Error as error:
        raise DamagedError(f"{path.name}: {error}") from None
    if found != "ok":
        raise DamagedError(f"{path.name}: {found}")
    # One that SQLite leaves has nothing in it to undo.
    path.with_name(path.name + JOURNAL).unlink(missing_ok=True)


def rebuild_sqlite(damaged: Path, target: Path) -> list[str]:
    """Write what can be read of an SQLite file into another; as `rebuild_mcap`.

    The damaged one is filled up to the length it had.
    """
    problems: list[str] = []
    _fill_up(damaged)
    rebuilt = SqliteStorage(target, NONE)
    try:
        with closing(sqlite3.connect(damaged)) as source:
            known = {found.id: found for found in _connections(source)}
            for found in known.values():
                rebuilt.add(found)
            for number, time, data in source.execute(
                "SELECT topic_id, timestamp, data FROM messages ORDER BY id"
            ):
                rebuilt.write(known[number], time, data)
    except (sqlite3.Error, LookupError) as error:
        problems.append(f"{damaged.name}: is read up to where it is damaged: {error}")
    rebuilt.close("")
    return problems


def _fill_up(path: Path) -> None:
    """Give a file that was cut off its length again: SQLite reads nothing of a shorter one."""
    with path.open("r+b") as file:
        header = file.read(_SQLITE_HEADER)
        if len(header) < _SQLITE_HEADER:
            return
        (page_size,) = struct.unpack_from(">H", header, _PAGE_SIZE)
        (pages,) = struct.unpack_from(">I", header, _PAGES)
        length = pages * (page_size if page_size > 1 else _LARGEST_PAGE)
        if length > path.stat().st_size:
            file.truncate(length)


def _connections(source: sqlite3.Connection) -> Iterator[Connection]:
    definitions = {
        name: MessageDefinition(MessageDefinitionFormat.MSG, text)
        for name, text in source.execute(
            "SELECT topic_type, encoded_message_definition FROM message_definitions"
        )
    }
    for number, name, kind, encoding, offered, digest in source.execute(
        "SELECT id, name, type, serialization_format, offered_qos_profiles,"
        " type_description_hash FROM topics"
    ):
        ext = ConnectionExtRosbag2(encoding, parse_qos(offered))
        yield Connection(number, name, kind, definitions[kind], digest, 0, ext, None)


def _records(file: BinaryIO) -> Iterator[_Record]:
    """Yield the records of an MCAP file's data; the last may be cut off."""
    while len(header := file.read(_RECORD.size)) == _RECORD.size:
        kind, length = _RECORD.unpack(header)
        # Where power was cut, a file may end in zeros.
        if kind in (_NOTHING, _DATA_END):
            return
        content = file.read(length)
        yield _Record(kind, content, len(content) == length)


def _unpacked(chunk: _Record) -> tuple[str, bytes, str]:
    """Return a chunk's compression, its records, and what is wrong with it."""
    compression = ""
    try:
        _, _, size, _, length = _CHUNK_START.unpack_from(chunk.content)
        place = _CHUNK_START.size + length
        compression = chunk.content[_CHUNK_START.size : place].decode()
        (packed,) = struct.unpack_from("<Q", chunk.content, place)
        records = chunk.content[place + 8 : place + 8 + packed]
        if not compression:
            return compression, records, "" if chunk.whole else "it was cut off"
        if not chunk.whole:
            return compression, b"", "it was cut off"
        return compression, DECOMPRESSORS[compression](records, size), ""
    except Exception as error:
        # Damaged data make decompressors raise whatever they happen to run into.
        return compression, b"", " ".join(str(error).split()) or type(error).__name__


def _walk(records: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield kind, start and end of the content of each whole record of a chunk."""
    place = 0
    while place + _RECORD.size <= len(records):
        kind, length = _RECORD.unpack_from(records, place)
        start = place + _RECORD.size
        place = start + length
        if kind == _NOTHING or place > len(records):
            return
        yield kind, start, place


def _texts(content: bytes, place: int, number: int) -> list[str]:
    """Return so many texts, each with its length before it."""
    found = []
    for _ in range(number):
        (length,) = struct.unpack_from("<I", content, place)
        found.append(content[place + 4 : place + 4 + length].decode())
        place += 4 + length
    return found
