"""Reads a bag of the graph: its signals as arrays, and its facts.

A bag that is damaged, or that another program wrote, is read as far as that is possible, and the
result names what is missing.
"""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.facts import facts_of
from haptic_accel.bags.folder import COMPRESSED, MCAP, METADATA, MUST_BE, is_storage, storage_files
from haptic_accel.bags.mcap import Block, IntArray, McapFile
from haptic_accel.bags.metadata import Metadata, MetadataError, read_metadata
from haptic_accel.core.cdr import unpack_stamped_vectors
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.topics import DIAGNOSTICS, SIGNALS, Topic

FloatArray = npt.NDArray[np.float64]

_EVENTS = "parameter_events"
_EVENTS_TYPE = "rcl_interfaces/msg/ParameterEvent"
_SIGNALS = {topic.name: topic for topic in SIGNALS}
_READ = (*_SIGNALS, DIAGNOSTICS.name)

# Fields of rcl_interfaces/msg/ParameterValue by the type of the value, from 1 on.
_TYPES = "bool integer double string byte_array bool_array integer_array double_array string_array"
_VALUES = {number: f"{name}_value" for number, name in enumerate(_TYPES.split(), start=1)}


@dataclass(frozen=True)
class Signal:
    """The stamped vectors of one topic, in the order in which they were recorded.

    Attributes
    ----------
    stamps, received : ndarray of int64, shape (n,)
        Times of the samples, and times at which their messages were recorded; system time, ns.
    values : ndarray, shape (n, 3)
        SI units; the actuator's axis is the third, z.
    """

    stamps: IntArray
    received: IntArray
    values: FloatArray


@dataclass(frozen=True)
class Diagnosis:
    """Diagnostic status that a node published.

    Attributes
    ----------
    received : int
        Time at which it was recorded, system time, ns.
    node, message : str
        Name of the node, and ``OK`` or a warning.
    values : dict
        Values as text, by name with unit.
    """

    received: int
    node: str
    message: str
    values: dict[str, str]


@dataclass(frozen=True)
class Change:
    """A parameter that was set while the bag was recorded.

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
class Bag:
    """Content of a bag.

    Attributes
    ----------
    path : Path
    signals : dict of Signal
        By the topic's name as in `core.topics`; only those that have messages.
    diagnostics : list of Diagnosis
    changes : list of Change
    facts : dict
        Facts stored by the recorder: ``version``, ``arguments``, ``parameters``, ``host``; empty
        in another program's bag.
    counts : dict
        Messages by full topic name.
    problems : list of str
        Parts that could not be read, a line each.
    """

    path: Path
    signals: dict[str, Signal]
    diagnostics: list[Diagnosis]
    changes: list[Change]
    facts: dict[str, Any]
    counts: dict[str, int]
    problems: list[str]


def read_bag(path: Path) -> Bag:
    """Read a bag.

    Parameters
    ----------
    path : Path
        A bag's folder, or one of its files.

    Raises
    ------
    ParameterError
        It is not a bag, or cannot be read at all.
    """
    problems: list[str] = []
    metadata = _metadata(path, problems) if path.is_dir() else Metadata(())
    try:
        sources = _sources(path, metadata, problems)
    except OSError as error:
        raise ParameterError(f"{path}: must be a bag: {error.strerror}") from None
    collected = _Collected(problems)
    custom = dict(metadata.custom)
    failures = []
    for source in sources:
        try:
            for block in _blocks(source, problems, custom):
                collected.take(block)
        except (OSError, ValueError, struct.error) as error:
            failures.append(f"{source.name} cannot be read: {error}")
    if len(failures) == len(sources) and not collected.counts:
        raise ParameterError(f"{path}: must be a bag: {failures[0]}")
    problems += failures
    return Bag(
        path,
        collected.signals(),
        collected.diagnostics,
        collected.changes,
        facts_of(custom),
        dict(collected.counts),
        problems,
    )


def _metadata(folder: Path, problems: list[str]) -> Metadata:
    """Return the metadata; that of an empty bag where there is none."""
    try:
        return read_metadata(folder)
    except MetadataError:
        if (folder / METADATA).exists():
            problems.append(f"{METADATA} cannot be read")
        else:
            problems.append(f"{METADATA} is missing: the recording was cut off")
        return Metadata(())


def _sources(path: Path, metadata: Metadata, problems: list[str]) -> list[Path]:
    """Return the files that hold messages, in order, or a folder that rosbags reads as a whole."""
    if not path.is_dir():
        path.stat()
        if not is_storage(path):
            raise ParameterError(f"{path}: must be a bag's folder, or a .mcap or .db3 file")
        return [path]
    # Those of a recording that was cut off are not all in the metadata.
    found = storage_files(path)
    if not found:
        raise ParameterError(f"{path}: {MUST_BE}")
    if metadata.compression_mode:
        return [path]
    named = [path / file.name for file in metadata.files]
    problems += [f"{file.name} is missing" for file in named if not file.exists()]
    first = [file for file in named if file in found]
    return first + [file for file in found if file not in first]


def _blocks(source: Path, problems: list[str], custom: dict[str, str]) -> Iterator[Block]:
    """Yield the messages of a file or folder, and complete the custom data from a file's own."""
    if source.suffix == COMPRESSED:
        raise ValueError(f"a compressed file is read with the {METADATA} of its folder")
    if source.suffix != MCAP:
        yield from _foreign_blocks(source)
        return
    mcap = McapFile(source)
    yield from mcap.blocks()
    if not custom:
        custom |= mcap.custom_data
    problems += mcap.problems
    if mcap.unfinished:
        problems.append(mcap.unfinished)


def _foreign_blocks(source: Path) -> Iterator[Block]:
    """Yield the messages of a bag of another form than ours, by topic."""
    rows: dict[tuple[str, str], list[tuple[int, bytes]]] = defaultdict(list)
    try:
        with Reader(source) as reader:
            for connection, received, data in reader.messages():
                rows[connection.topic, connection.msgtype].append((received, bytes(data)))
    except Exception as error:
        # Damaged files make the readers of rosbags raise whatever they happen to run into.
        raise ValueError(" ".join(str(error).split())) from None
    for (topic, kind), messages in rows.items():
        lengths = np.array([len(data) for _, data in messages], dtype=np.int64)
        ends = np.cumsum(lengths)
        joined = np.frombuffer(b"".join(data for _, data in messages), np.uint8)
        times = np.array([time for time, _ in messages], dtype=np.int64)
        yield Block(topic, kind, times, joined, ends - lengths, ends)


def _messages(block: Block) -> Iterator[bytes]:
    for start, end in zip(block.starts.tolist(), block.ends.tolist(), strict=True):
        yield block.bytes[start:end].tobytes()


@dataclass
class _Collected:
    """Messages read so far."""

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
        topic = block.topic
        self.counts[topic] += len(block.received)
        namespace, name = _split(topic)
        if topic.endswith(f"/{_EVENTS}") and block.type == _EVENTS_TYPE:
            self._take_changes(block)
        elif name and self._is_ours(namespace):
            if name == DIAGNOSTICS.name:
                self._take_diagnostics(block)
            elif self._is_of_type(block, _SIGNALS[name]):
                self._take_signal(name, block)

    def signals(self) -> dict[str, Signal]:
        """Return the signals collected."""
        return {
            name: Signal(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
            for name, parts in self._parts.items()
        }

    def _is_ours(self, namespace: str) -> bool:
        """Return whether a namespace is that of the first graph in the bag, the only one read."""
        if self._namespace is None:
            self._namespace = namespace
        if namespace != self._namespace:
            self._once(f"topics below {namespace or '/'} belong to another graph and are not read")
        return namespace == self._namespace

    def _is_of_type(self, block: Block, topic: Topic) -> bool:
        if block.type != topic.type:
            self._once(f"{block.topic} is {block.type}, not {topic.type}: it is not read")
        return block.type == topic.type

    def _take_signal(self, name: str, block: Block) -> None:
        try:
            stamps, values = unpack_stamped_vectors(block.bytes, block.starts, block.ends)
        except ValueError as error:
            self._once(f"{block.topic}: {error}")
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
                yield received, self._types.deserialize_cdr(data, block.type)
            except Exception as error:
                # Bytes that are no such message raise whatever they happen to run into.
                self._once(f"{block.topic}: a message cannot be read: {error}")

    def _once(self, problem: str) -> None:
        if problem not in self.problems:
            self.problems.append(problem)


def _split(topic: str) -> tuple[str, str]:
    """Return the namespace before a topic of the graph, and its name in our table."""
    for name in _READ:
        if topic.endswith(f"/{name}"):
            return topic.removesuffix(f"/{name}"), name
    return "", ""
