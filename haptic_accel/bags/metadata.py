# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Metadata of a bag (metadata.yaml), which rosbag2 reads before the bag's files.

Type definitions are stored in a bag, so that it can be read without the types installed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

import yaml
from rosbags import interfaces
from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v9, parse_qos  # undocumented: see setup.py
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from haptic_accel.bags.folder import METADATA
from haptic_accel.bags.mcap import DAMAGE_ERRORS, NEVER, Channel, McapFile, Tally, read_text_map
from haptic_accel.core.document import Document, load_yaml, texts_of
from haptic_accel.core.files import read_bytes, replace_file
from haptic_accel.core.parameters import Specification, one_line
from haptic_accel.core.sampling import NANOSECONDS


class UndefinedTypeError(LookupError):
    """Error: a message type has no definition; the message is one line."""


def connection(number: int, topic: str, kind: str, offered: Sequence[Qos]) -> Connection:
    """Return a topic as rosbags connection, with the type's definition and hash.

    Parameters
    ----------
    number : int
        Number from 1, unique in the bag.
    topic : str
        Full name.
    kind : str
        Message type, for example ``std_msgs/msg/String``.
    offered : sequence of Qos
        Quality of service offered by its publishers.

    Raises
    ------
    UndefinedTypeError
        The type is unknown to rosbags, and not found in any installed package.
    """
    definition, digest = _definition(kind)
    stored = interfaces.MessageDefinition(interfaces.MessageDefinitionFormat.MSG, definition)
    form = interfaces.ConnectionExtRosbag2("cdr", list(offered))
    return Connection(number, topic, kind, stored, digest, 0, form, None)


@cache
def _definition(kind: str) -> tuple[str, str]:
    """Return the text of a type, with nested types, and its hash (REP 2016)."""
    types = types_store()
    try:
        _add_installed(types, kind)
        text, _ = types.generate_msgdef(kind, ros_version=2)
        return text, types.hash_rihs01(kind)
    except (ImportError, OSError, LookupError, ValueError, TypesysError) as error:
        raise UndefinedTypeError(f"{kind}: no definition: {error}") from None


@cache
def types_store() -> Typestore:
    """Return the known types; cached, as their readers are compiled once."""
    return get_typestore(Stores.ROS2_JAZZY)


def _add_installed(types: Typestore, kind: str) -> None:
    """Register a type and nested types from the .msg files of installed packages."""
    if kind in types.fielddefs:
        return
    found = get_types_from_msg(_message_file(kind).read_text(encoding="utf-8"), kind)
    for _, fields in found.values():
        for name in _names(fields):
            if "/msg/" in name:
                _add_installed(types, name)
    types.register(found)


def _message_file(kind: str) -> Path:
    # Imported for types unknown to rosbags only, as it needs an installed ROS 2.
    from ament_index_python.packages import get_package_share_directory

    package, _, name = kind.split("/")
    return Path(get_package_share_directory(package)) / "msg" / f"{name}.msg"


def _names(parsed: object) -> Iterator[str]:
    """Yield all texts in nested tuples and lists, which include type names."""
    if isinstance(parsed, str):
        yield parsed
    elif isinstance(parsed, (tuple, list)):
        for part in parsed:
            yield from _names(part)


VERSION = 9
"""Version of metadata.yaml, written by Jazzy and later."""

STORAGE = "mcap"
"""Storage identifier of bags written here."""

_SUM = "# CRC-32 of the lines above: "
"""Start of the last line; a comment in YAML. Files of other programs lack it."""

# The dumper of libyaml, if PyYAML includes it, is ten times faster.
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

_ROOT = "rosbag2_bagfile_information"
_COUNT = Specification("number of messages, or time", "", 0, NEVER)
_LONG = 2**31 - 1
"""Line width that prevents wrapping of any text, columns."""


class MetadataError(Exception):
    """Error: a metadata.yaml cannot be read; the message is one line."""


@dataclass(frozen=True)
class FileEntry:
    """Metadata of one file of a bag.

    Attributes
    ----------
    name : str
        Name relative to the bag's folder.
    start, end : int
        Recording times of the first and last message, system time in ns; `NEVER` and 0 without
        messages.
    messages : int
        Number of messages.
    """

    name: str
    start: int = NEVER
    end: int = 0
    messages: int = 0


@dataclass(frozen=True)
class TopicEntry:
    """Metadata of one topic: name, type, offered quality of service, and number of messages."""

    name: str
    type: str
    serialization_format: str
    offered_qos_profiles: tuple[Qos, ...]
    type_description_hash: str
    messages: int = 0


@dataclass(frozen=True)
class Metadata:
    """Contents of metadata.yaml.

    Attributes
    ----------
    files : tuple of FileEntry
        Files in recording order.
    topics : tuple of TopicEntry
    custom : dict
        Custom data, text by name.
    storage : str
        ``mcap``, or ``sqlite3`` for some bags of other programs.
    compression_mode, compression_format : str
        Compression of files or messages by another program; empty for none.
    distro : str
        ROS distribution of the type definitions in the bag.
    """

    files: tuple[FileEntry, ...]
    topics: tuple[TopicEntry, ...] = ()
    custom: Mapping[str, str] = field(default_factory=dict)
    storage: str = STORAGE
    compression_mode: str = ""
    compression_format: str = ""
    distro: str = "jazzy"

    @classmethod
    def of(cls, file: McapFile, tally: Tally) -> Metadata:
        """Return the metadata of a bag with one file, whose channels have been read."""
        topics = tuple(_channel_entry(c, tally.counts[c.id]) for c in file.channels.values())
        return cls((file_entry(file.path.name, tally),), topics)

    @property
    def messages(self) -> int:
        """Number of messages in the bag."""
        return sum(file.messages for file in self.files)

    @property
    def start(self) -> int:
        """Recording time of the first message, system time in ns."""
        return min((file.start for file in self.files), default=NEVER)

    @property
    def duration(self) -> int:
        """Time from the first message to the last, ns."""
        return max(0, max((file.end for file in self.files), default=0) - self.start)

    @property
    def seconds(self) -> float:
        """Time from the first message to the last, s; 0 without messages."""
        return self.duration / NANOSECONDS if self.messages else 0.0

    @property
    def text(self) -> str:
        """Metadata as text for a storage file, where rosbag2 reads them."""
        return _yaml(self._content())

    def write(self, folder: Path) -> None:
        """Write metadata.yaml; a complete file exists at all times.

        Raises
        ------
        OSError
            The file cannot be written; an earlier file remains.
        """
        content = _yaml({_ROOT: self._content()}).encode()
        replace_file(folder / METADATA, content + f"{_SUM}{crc32(content):08x}\n".encode())

    def _content(self) -> dict[str, Any]:
        return {
            "version": VERSION,
            "storage_identifier": self.storage,
            "duration": {"nanoseconds": self.duration},
            "starting_time": {"nanoseconds_since_epoch": self.start},
            "message_count": self.messages,
            "topics_with_message_count": [_topic(topic) for topic in self.topics],
            "compression_format": self.compression_format,
            "compression_mode": self.compression_mode,
            "relative_file_paths": [file.name for file in self.files],
            "files": [_file(file) for file in self.files],
            "custom_data": dict(self.custom) or None,
            "ros_distro": self.distro,
        }


def topic_entry(connection: Connection, messages: int) -> TopicEntry:
    """Return the entry of a topic."""
    assert isinstance(connection.ext, ConnectionExtRosbag2)
    topic, kind, digest = connection.topic, connection.msgtype, connection.digest
    form, offered = connection.ext.serialization_format, connection.ext.offered_qos_profiles
    return TopicEntry(topic, kind, form, tuple(offered), digest, messages)


def _channel_entry(channel: Channel, messages: int) -> TopicEntry:
    """Return the entry of an MCAP file's channel."""
    texts: dict[str, str] = {}
    offered: tuple[Qos, ...] = ()  # default for a damaged channel
    with suppress(ReaderError, *DAMAGE_ERRORS):
        texts = read_text_map(channel.metadata)
        offered = _read_qos(texts.get("offered_qos_profiles", ""))
    form, digest = channel.message_encoding, texts.get("topic_type_hash", "")
    return TopicEntry(channel.topic, channel.schema, form, offered, digest, messages)


def file_entry(name: str, tally: Tally) -> FileEntry:
    """Return the entry of an MCAP file with a number of messages."""
    return FileEntry(name, tally.start, tally.end, tally.messages)


def read_metadata(folder: Path) -> Metadata:
    """Read a bag's metadata.yaml of any rosbag2 version.

    Raises
    ------
    MetadataError
        The file is missing or cannot be read.
    """
    path = folder / METADATA
    try:
        text = _checked_text(path)
        return _metadata(Document(Path(METADATA), load_yaml(text), text).at(_ROOT))
    except OSError as error:
        raise MetadataError(f"{path}: {error.strerror}") from None
    except (ReaderError, *DAMAGE_ERRORS) as error:
        raise MetadataError(f"{path}: is not metadata of a bag: {one_line(error)}") from None


def _checked_text(path: Path) -> str:
    """Return the text of a metadata.yaml.

    Raises
    ------
    ValueError
        The file is not a text, or does not match its checksum.
    OSError
        The path is not a file, or the file is too large.
    """
    content = read_bytes(path)
    match = re.search(rb"%s([0-9a-f]{8})\n?\Z" % _SUM.encode(), content)
    if match and crc32(content[: match.start()]) != int(match[1], 16):
        raise ValueError("it differs from its checksum, which is its last line")
    return content.decode()


def qos_text(offered: Sequence[Qos]) -> str:
    """Return a topic's offered quality of service as text for storage files."""
    return _yaml(dump_qos_v9(list(offered))).strip()


def _metadata(content: Document) -> Metadata:
    mode = content.get("compression_mode", "").text().lower()
    return Metadata(
        files=tuple(_files(content)),
        topics=tuple(map(_read_topic, content.at("topics_with_message_count").items())),
        custom=texts_of(content.get("custom_data").value),
        storage=content.at("storage_identifier").text(),
        compression_mode="" if mode == "none" else mode,
        compression_format=content.get("compression_format", "").text(),
        distro=content.get("ros_distro", "").text(),
    )


def _files(content: Document) -> list[FileEntry]:
    names = [Path(each.text()).name for each in content.at("relative_file_paths").items()]
    described = list(content.get("files", []).items())
    if not described:  # before version 5
        first, *others = names
        return [_read_file(first, content), *map(FileEntry, others)]
    return [_read_file(name, file) for name, file in zip(names, described, strict=True)]


def _read_file(name: str, content: Document) -> FileEntry:
    count = _count(content, "message_count")
    if not count:
        return FileEntry(name)
    start = _count(content, "starting_time", "nanoseconds_since_epoch")
    end = start + _count(content, "duration", "nanoseconds")
    if end > NEVER:
        content.at("duration").wrong(f"must end at {NEVER} ns")
    return FileEntry(name, start, end, count)


def _count(content: Document, *keys: str) -> int:
    """Return a number of messages or a time, ns."""
    return int(content.at(*keys).checked(0, _COUNT))


def _read_topic(content: Document) -> TopicEntry:
    topic = content.at("topic_metadata")
    name, kind, form = (topic.at(key).text() for key in ("name", "type", "serialization_format"))
    offered = _read_qos(topic.get("offered_qos_profiles", []).value)
    digest = topic.get("type_description_hash", "").text()
    return TopicEntry(name, kind, form, offered, digest, _count(content, "message_count"))


def _read_qos(offered: Any) -> tuple[Qos, ...]:
    """Return the quality of service, which was YAML text before version 9."""
    return tuple(parse_qos(load_yaml(offered) if isinstance(offered, str) else offered))


def _topic(topic: TopicEntry) -> dict[str, Any]:
    offered = dump_qos_v9(list(topic.offered_qos_profiles))
    described = vars(topic) | {"offered_qos_profiles": offered}
    count = described.pop("messages")
    return {"topic_metadata": described, "message_count": count}


def _file(file: FileEntry) -> dict[str, Any]:
    return {
        "path": file.name,
        "starting_time": {"nanoseconds_since_epoch": file.start},
        "duration": {"nanoseconds": max(0, file.end - file.start)},
        "message_count": file.messages,
    }


def _yaml(content: Any) -> str:
    return str(
        yaml.dump(content, Dumper=_DUMPER, sort_keys=False, width=_LONG, allow_unicode=True)
    )
