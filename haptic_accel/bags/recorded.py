"""Reads a bag of the graph: its signals as arrays, and what it says of itself.

A bag that is damaged, or that another program wrote, is read as far as that is possible, and says
what is missing.
"""

from __future__ import annotations

import json
import sqlite3
import struct
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import numpy.typing as npt
import yaml
from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.mcap import Block, Channel, IntArray, McapFile
from haptic_accel.core.cdr import unpack_stamped_vectors
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import DIAGNOSTICS, SIGNALS, Topic

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd  # as rosbags has it

FloatArray = npt.NDArray[np.float64]

FACTS = "haptic_accel."
"""What the keys begin with by which the recorder stores facts in a bag's custom data."""

METADATA = "metadata.yaml"
MCAP_SUFFIX = ".mcap"
SQLITE_SUFFIX = ".db3"
COMPRESSED = ".zstd"

_EVENTS = "parameter_events"
_EVENTS_TYPE = "rcl_interfaces/msg/ParameterEvent"
_SIGNALS = {topic.name: topic for topic in SIGNALS}
_READ = (*_SIGNALS, DIAGNOSTICS.name)
_ROWS = 50_000  # of an SQLite bag that are taken at once

# Of rcl_interfaces/msg/ParameterValue: the field that holds a value of each type.
_VALUES = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    5: "byte_array_value",
    6: "bool_array_value",
    7: "integer_array_value",
    8: "double_array_value",
    9: "string_array_value",
}


@dataclass(frozen=True)
class Signal:
    """The stamped vectors of one topic, in the order in which they were recorded.

    Attributes
    ----------
    stamps, received : ndarray of int64, shape (n,)
        The time of the sample that a message is about, and when it was recorded; system time, ns.
    values : ndarray, shape (n, 3)
        SI units; the actuator's axis is the third, z.
    """

    stamps: IntArray
    received: IntArray
    values: FloatArray


@dataclass(frozen=True)
class Diagnosis:
    """What a node said of itself.

    Attributes
    ----------
    received : int
        When it was recorded, system time, ns.
    node, message : str
        ``OK``, or a complaint.
    values : dict
        Figures by name with unit.
    """

    received: int
    node: str
    message: str
    values: dict[str, str]


@dataclass(frozen=True)
class Change:
    """A parameter that got a value while the bag was recorded.

    Attributes
    ----------
    received : int
        System time, ns.
    node, parameter : str
        The node's name without namespace, the parameter's dotted name.
    value
        bool, int, float, str, or a list of them.
    """

    received: int
    node: str
    parameter: str
    value: Any


@dataclass(frozen=True)
class Recorded:
    """What a bag holds.

    Attributes
    ----------
    path : Path
    signals : dict of Signal
        By the topic's name as in `nodes.topics`; only those that have messages.
    diagnostics : list of Diagnosis
    changes : list of Change
    facts : dict
        What the recorder stored: ``version``, ``arguments``, ``parameters``, ``host``; nothing in
        another program's bag.
    counts : dict
        Messages by full topic name.
    problems : list of str
        What could not be read, a line each.
    """

    path: Path
    signals: dict[str, Signal]
    diagnostics: list[Diagnosis]
    changes: list[Change]
    facts: dict[str, Any]
    counts: dict[str, int]
    problems: list[str]


def read_bag(path: Path) -> Recorded:
    """Read a bag.

    Parameters
    ----------
    path : Path
        A bag's folder, or one of its files.

    Raises
    ------
    ParameterError
        It is no bag, or cannot be read at all.
    """
    problems: list[str] = []
    try:
        description = _description(path, problems)
        files = _files(path, description, problems)
    except OSError as error:
        raise ParameterError(f"{path}: must be a bag: {error.strerror}") from None
    collected = _Collected(problems)
    by_message = description.get("compression_mode") == "message"
    custom = _mapping(description.get("custom_data"))
    failures = []
    for file in files:
        try:
            for block in _blocks(file, problems, custom):
                collected.take(_decompressed(block) if by_message else block)
        except (OSError, ValueError, struct.error, sqlite3.Error, zstd.ZstdError) as error:
            failures.append(f"{file.name} cannot be read: {error}")
    if len(failures) == len(files) and not collected.counts:
        raise ParameterError(f"{path}: must be a bag: {failures[0]}")
    problems += failures
    return Recorded(
        path,
        collected.signals(),
        collected.diagnostics,
        collected.changes,
        _facts(custom),
        dict(collected.counts),
        problems,
    )


def _description(path: Path, problems: list[str]) -> dict[str, Any]:
    """Return what metadata.yaml says; nothing where there is none."""
    file = path / METADATA
    if not path.is_dir() or not file.exists():
        if path.is_dir():
            problems.append(f"{METADATA} is missing: the recording was cut off")
        return {}
    try:
        content = yaml.load(
            file.read_text(encoding="utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        )
        return _mapping(content["rosbag2_bagfile_information"])
    except (yaml.YAMLError, KeyError, TypeError, ValueError):
        problems.append(f"{METADATA} cannot be read")
        return {}


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _files(path: Path, description: dict[str, Any], problems: list[str]) -> list[Path]:
    """Return the files that hold messages, in order."""
    if not path.is_dir():
        path.stat()
        if not _is_storage(path):
            raise ParameterError(f"{path}: must be a bag's folder, or a .mcap or .db3 file")
        return [path]
    named = [path / str(name) for name in description.get("relative_file_paths") or []]
    for file in named:
        if not file.exists():
            problems.append(f"{file.name} is missing")
    # Those of a recording that was cut off are not all in the metadata.
    found = sorted((file for file in path.iterdir() if _is_storage(file)), key=_number)
    # A recorder that died after it compressed a file may have left the plain one.
    found = [file for file in found if file.with_name(file.name + COMPRESSED) not in found]
    if not found:
        raise ParameterError(f"{path}: must be a bag: it has no .mcap or .db3 file")
    first = [file for file in named if file in found]
    return first + [file for file in found if file not in first]


def _is_storage(file: Path) -> bool:
    name = file.name.removesuffix(COMPRESSED)
    return name.endswith((MCAP_SUFFIX, SQLITE_SUFFIX))


def _number(file: Path) -> tuple[int, str]:
    """Order splits by their number, as in ``name_10.mcap``."""
    digits = file.name.split(".")[0].rpartition("_")[2]
    return (int(digits) if digits.isdecimal() else 0, file.name)


def _blocks(file: Path, problems: list[str], custom: dict[str, Any]) -> Iterator[Block]:
    """Yield a file's messages, and add what it says of itself to custom data."""
    if file.name.endswith(COMPRESSED):
        with TemporaryDirectory() as folder:
            plain = Path(folder) / file.name.removesuffix(COMPRESSED)
            with zstd.open(file, "rb") as compressed, plain.open("wb") as out:
                while part := compressed.read(1 << 20):
                    out.write(part)
            yield from _blocks(plain, problems, custom)
        return
    if file.name.endswith(SQLITE_SUFFIX):
        yield from _rows(file)
        return
    mcap = McapFile(file)
    yield from mcap.blocks()
    problems += mcap.problems
    text = mcap.metadata.get("rosbag2", {}).get("serialized_metadata", "")
    if not custom and text:
        try:
            custom |= _mapping(_mapping(yaml.safe_load(text)).get("custom_data"))
        except (yaml.YAMLError, ValueError):
            problems.append(f"{file.name}: what it says of itself cannot be read")


def _rows(file: Path) -> Iterator[Block]:
    """Yield the messages of an SQLite file."""
    # Writable, so that what a killed recorder left half done is undone.
    connection = sqlite3.connect(f"{file.absolute().as_uri()}?mode=rw", uri=True)
    try:
        topics = connection.execute("SELECT id, name, type FROM topics").fetchall()
        for number, name, kind in topics:
            cursor = connection.execute(
                "SELECT timestamp, data FROM messages WHERE topic_id = ? ORDER BY id", (number,)
            )
            while rows := cursor.fetchmany(_ROWS):
                yield _joined(
                    Channel(name, kind),
                    np.array([row[0] for row in rows], dtype=np.int64),
                    [row[1] for row in rows],
                )
    finally:
        connection.close()


def _joined(channel: Channel, received: IntArray, messages: list[bytes]) -> Block:
    ends = np.cumsum([len(message) for message in messages], dtype=np.int64)
    starts = np.concatenate([[0], ends[:-1]]).astype(np.int64)
    return Block(channel, received, np.frombuffer(b"".join(messages), np.uint8), starts, ends)


def _decompressed(block: Block) -> Block:
    """Return a block whose messages were compressed one by one."""
    messages = [zstd.decompress(message) for message in _messages(block)]
    return _joined(block.channel, block.received, messages)


def _messages(block: Block) -> Iterator[bytes]:
    for start, end in zip(block.starts.tolist(), block.ends.tolist(), strict=True):
        yield block.bytes[start:end].tobytes()


@dataclass
class _Collected:
    """What was read so far."""

    problems: list[str]
    diagnostics: list[Diagnosis] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    _parts: dict[str, list[tuple[IntArray, IntArray, FloatArray]]] = field(default_factory=dict)
    _namespace: str | None = None

    def __post_init__(self) -> None:
        """Prepare to read messages."""
        self._types = get_typestore(Stores.ROS2_JAZZY)

    def take(self, block: Block) -> None:
        """Add a block of messages."""
        topic = block.channel.topic
        self.counts[topic] += len(block.received)
        namespace, name = _split(topic)
        if topic.endswith(f"/{_EVENTS}") and block.channel.type == _EVENTS_TYPE:
            self._take_changes(block)
        elif name and self._is_ours(namespace):
            if name == DIAGNOSTICS.name:
                self._take_diagnostics(block)
            elif self._is_of_type(block.channel, _SIGNALS[name]):
                self._take_signal(name, block)

    def signals(self) -> dict[str, Signal]:
        """Return what was collected of each signal."""
        return {
            name: Signal(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
            for name, parts in self._parts.items()
        }

    def _is_ours(self, namespace: str) -> bool:
        """Of several graphs in one bag, only the first is read."""
        if self._namespace is None:
            self._namespace = namespace
        if namespace != self._namespace:
            self._once(f"topics below {namespace or '/'} belong to another graph and are not read")
        return namespace == self._namespace

    def _is_of_type(self, channel: Channel, topic: Topic) -> bool:
        if channel.type != topic.type:
            self._once(f"{channel.topic} is {channel.type}, not {topic.type}: it is not read")
        return channel.type == topic.type

    def _take_signal(self, name: str, block: Block) -> None:
        try:
            stamps, values = unpack_stamped_vectors(block.bytes, block.starts, block.ends)
        except ValueError as error:
            self._once(f"{block.channel.topic}: {error}")
            return
        self._parts.setdefault(name, []).append((stamps, block.received, values))

    def _take_diagnostics(self, block: Block) -> None:
        for received, message in self._decoded(block):
            self.diagnostics += [
                Diagnosis(
                    received,
                    status.name,
                    status.message,
                    {pair.key: pair.value for pair in status.values},
                )
                for status in message.status
            ]

    def _take_changes(self, block: Block) -> None:
        for received, message in self._decoded(block):
            node = message.node.rsplit("/", 1)[-1]
            for changed in (*message.new_parameters, *message.changed_parameters):
                value = getattr(changed.value, _VALUES.get(changed.value.type, ""), None)
                if isinstance(value, np.ndarray):
                    value = value.tolist()
                self.changes.append(Change(received, node, changed.name, value))

    def _decoded(self, block: Block) -> Iterator[tuple[int, Any]]:
        for received, data in zip(block.received.tolist(), _messages(block), strict=True):
            try:
                yield received, self._types.deserialize_cdr(data, block.channel.type)
            except Exception as error:
                # Bytes that are no such message raise whatever they happen to run into.
                self._once(f"{block.channel.topic}: a message cannot be read: {error}")

    def _once(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)


def _split(topic: str) -> tuple[str, str]:
    """Return the namespace before a topic of the graph, and its name in our table."""
    for name in _READ:
        if topic.endswith(f"/{name}"):
            return topic.removesuffix(f"/{name}"), name
    return "", ""


def _facts(custom: dict[str, Any]) -> dict[str, Any]:
    """Return what our recorder stored."""
    facts: dict[str, Any] = {}
    for key, text in custom.items():
        if not str(key).startswith(FACTS):
            continue
        name = str(key).removeprefix(FACTS)
        try:
            facts[name] = json.loads(text) if str(text).startswith("{") else text
        except ValueError:
            facts[name] = text
    return facts
