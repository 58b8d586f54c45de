"""Looks at the files of a bag: which there are, whether they are whole, and what they hold."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.storage_mcap import Channel, McapReader, get_qos
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from haptic_accel.bags.compression import SUFFIX as COMPRESSED
from haptic_accel.bags.metadata import NEVER, FileEntry, TopicEntry, topic_entry
from haptic_accel.bags.recording_options import MCAP
from haptic_accel.bags.storage import SUFFIXES

JOURNAL = "-journal"
"""Behind the name of an SQLite file: what undoes a transaction that was not finished."""

_DAMAGED = (ReaderError, OSError, ValueError, TypeError, LookupError, struct.error)
"""What rosbags' readers raise where a file is not as it should be."""


class DamagedError(Exception):
    """A file of a bag cannot be read by its index; the message is one line."""


@dataclass(frozen=True)
class Contents:
    """What a file of a bag holds.

    Attributes
    ----------
    file : FileEntry
    topics : tuple of TopicEntry
        With the numbers of their messages in this file.
    """

    file: FileEntry
    topics: tuple[TopicEntry, ...]


def storage_files(folder: Path) -> list[Path]:
    """Return the files of a bag in the order of their numbers, compressed ones too."""
    found = [path for path in folder.iterdir() if path.is_file() and storage_of(path)]
    return sorted(found, key=lambda path: (_number(path), path.name))


def storage_of(path: Path) -> str:
    """Return a file's storage by its name; empty where it is no file of a bag."""
    suffix = Path(path.name.removesuffix(COMPRESSED)).suffix
    return next((storage for storage, known in SUFFIXES.items() if known == suffix), "")


def inspect(path: Path) -> Contents:
    """Return what a file that is not compressed holds, by its index.

    Raises
    ------
    DamagedError
        It has none, or is not what its name says.
    """
    if path.with_name(path.name + JOURNAL).exists():
        raise DamagedError(f"{path.name}: was not closed: a transaction is to be undone")
    reader = McapReader(path) if storage_of(path) == MCAP else Sqlite3Reader(path)
    try:
        reader.open()
        with closing(reader):
            return _contents(path.name, reader)
    except _DAMAGED as error:
        reason = " ".join(str(error).split()).rstrip(".")
        raise DamagedError(f"{path.name}: was not closed, or is damaged: {reason}") from None


def merged(files: Iterable[Contents]) -> tuple[TopicEntry, ...]:
    """Return the topics of several files with all their messages."""
    topics: dict[tuple[str, str], TopicEntry] = {}
    for contents in files:
        for topic in contents.topics:
            key = (topic.name, topic.type)
            before = topics[key].messages if key in topics else 0
            topics[key] = replace(topic, messages=before + topic.messages)
    return tuple(topics.values())


def channel_entry(channel: Channel, messages: int) -> TopicEntry:
    """Return what metadata.yaml says of an MCAP file's channel."""
    return TopicEntry(
        channel.topic,
        channel.schema,
        channel.message_encoding,
        tuple(get_qos(channel.metadata)),
        pairs(channel.metadata).get("topic_type_hash", ""),
        messages,
    )


def pairs(content: bytes) -> dict[str, str]:
    """Return an MCAP record's map of texts."""
    texts = []
    place = 0
    while place < len(content):
        (length,) = struct.unpack_from("<I", content, place)
        place += 4
        texts.append(content[place : place + length].decode())
        place += length
    return dict(zip(texts[::2], texts[1::2], strict=True))


def _contents(name: str, reader: McapReader | Sqlite3Reader) -> Contents:
    topics = tuple(_topic(reader, connection) for connection in reader.connections)
    known = reader.metadata
    if not known.message_count:
        return Contents(FileEntry(name, NEVER, 0, 0), topics)
    entry = FileEntry(name, known.start_time, known.end_time - 1, known.message_count)
    return Contents(entry, topics)


def _topic(reader: McapReader | Sqlite3Reader, connection: Connection) -> TopicEntry:
    if isinstance(reader, McapReader) and connection.id in reader.channels:
        return channel_entry(reader.channels[connection.id], connection.msgcount)
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    return topic_entry(connection, connection.msgcount)


def _number(path: Path) -> int:
    digits = path.name.split(".")[0].rpartition("_")[2]
    return int(digits) if digits.isdecimal() else 0
