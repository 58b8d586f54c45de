# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Reader of the graph's bags: signals as arrays, metadata.

Damaged bags and bags of other programs are read as far as possible. The result lists the missing
parts.
"""

from __future__ import annotations

import os
import sqlite3
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from haptic_accel.bags.expanding import Allowance, decompressed_file, decompressed_message
from haptic_accel.bags.facts import facts_of
from haptic_accel.bags.folder import COMPRESSED, MCAP, METADATA, MUST_BE, is_storage, storage_files
from haptic_accel.bags.mcap import DAMAGE_ERRORS, MOST_PROBLEMS, Block, McapFile
from haptic_accel.bags.metadata import Metadata, MetadataError, read_metadata
from haptic_accel.core.axes import ACTUATOR_AXES, NAMES, Axes
from haptic_accel.core.cdr import unpack_stamped_vectors
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError
from haptic_accel.core.sampling import (
    HIGHEST_LATENCY,
    BoolArray,
    IntArray,
    coupled_stretches,
    on_grid,
    places,
)
from haptic_accel.core.topics import (
    ACTUATOR_FORCE,
    CONTACT_FORCE,
    DESIRED_ACCELERATION,
    DIAGNOSTICS,
    SIGNALS,
    ArmTopics,
    reporter,
)

_EVENTS = "parameter_events"
_EVENTS_TYPE = "rcl_interfaces/msg/ParameterEvent"
_SIGNALS = {topic.name: topic for topic in (*SIGNALS, CONTACT_FORCE)}
_REPORTS = "diagnostics"

# Fields of rcl_interfaces/msg/ParameterValue by the type of the value, from 1 on.
_TYPES = "bool integer double string byte_array bool_array integer_array double_array string_array"
_VALUES = {number: f"{name}_value" for number, name in enumerate(_TYPES.split(), start=1)}


@dataclass(frozen=True)
class Signal:
    """Stamped vectors of one topic, in recording order.

    `received` and `values` are empty if `read_bag` was called without them.

    Attributes
    ----------
    stamps, received : ndarray of int64, shape (n,)
        Times of the samples, and recording times of their messages; system time, ns.
    values : ndarray, shape (n, 3)
        Vectors in SI units.
    """

    stamps: IntArray
    received: IntArray
    values: FloatArray

    def on_grid(
        self, start: int, rate: float, length: int, axes: Axes = ACTUATOR_AXES
    ) -> tuple[FloatArray, BoolArray]:
        """Return the components along some axes on a grid, and a mask of samples.

        The components have shape (n,) for one axis, and (n, k) for several. Parameters as for
        `core.sampling.places` and `core.sampling.on_grid`.
        """
        where = places(self.stamps, start, rate)
        first, *others = axes.indices
        along = self.values[:, [first, *others] if others else first]
        return on_grid(where, along, length)


@dataclass(frozen=True)
class Diagnosis:
    """Diagnostic status of a node.

    Attributes
    ----------
    received : int
        Recording time, system time, ns.
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
    """Change of a parameter during the recording.

    Attributes
    ----------
    received : int
        System time, ns.
    node, parameter : str
        Name of the node without namespace, and dotted name of the parameter.
    value
        Value of type bool, int, float, str, or a list of them.
    """

    received: int
    node: str
    parameter: str
    value: Any


@dataclass(frozen=True)
class Bag:
    """Contents of a bag.

    Attributes
    ----------
    path : Path
    signals : dict of Signal
        Signals by topic name as in `core.topics`, for topics with messages only.
    diagnostics : list of Diagnosis
    changes : list of Change
    facts : dict
        Data stored by the recorder: ``version``, ``arguments``, ``parameters``, ``host``; empty
        for bags of other programs.
    counts : dict
        Number of messages by full topic name.
    problems : list of str
        Unreadable parts, one line each.
    """

    path: Path
    signals: dict[str, Signal] = field(default_factory=dict)
    diagnostics: list[Diagnosis] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)

    @property
    def latency(self) -> int:
        """Delay from sample to force, in samples.

        0 for forces applied on arrival, as in bags without a stated latency.
        """
        arguments = self.facts.get("arguments")
        stated = arguments.get("latency") if isinstance(arguments, dict) else None
        return stated if isinstance(stated, int) and 0 <= stated <= HIGHEST_LATENCY else 0

    @property
    def axes(self) -> Axes:
        """Axes of the vibration: those of the compensator, or those along which it ever acted."""
        nodes = self.facts.get("parameters")
        compensator = nodes.get("compensator") if isinstance(nodes, dict) else None
        stated = compensator.get("axes") if isinstance(compensator, dict) else None
        if isinstance(stated, str):
            with suppress(ParameterError):
                return Axes.parsed(stated)
        acted = [
            self.signals[topic.name].values
            for topic in (DESIRED_ACCELERATION, ACTUATOR_FORCE)
            if topic.name in self.signals
        ]
        names = tuple(
            name
            for place, name in enumerate(NAMES)
            if any((np.abs(values[:, place]) > 0.0).any() for values in acted)
        )
        return Axes(names) if names else ACTUATOR_AXES

    def coupled(self, arm: ArmTopics) -> list[tuple[int, int]]:
        """Return start and end of each period in which an arm was coupled, ns.

        Empty without forces of the arm's motors; see `core.sampling.coupled_stretches`.
        """
        forces, samples = (self.signals.get(t.name) for t in (arm.arm_force, arm.acceleration))
        if forces is None:
            return []
        stamps = np.array([], np.int64) if samples is None else np.sort(samples.stamps)
        return coupled_stretches(forces.stamps, forces.values, stamps)


def read_bag(path: Path | str, vectors: Collection[str] | None = None) -> Bag:
    """Read a bag.

    Parameters
    ----------
    path : Path or str
        Folder of a bag, or one of its files.
    vectors : collection of str, optional
        Names of the topics whose vectors are needed. Other topics keep only stamps, without
        recording times, which takes a fifth of the memory. Default: everything.

    Raises
    ------
    ParameterError
        The path is no bag, or the bag is unreadable.
    """
    path = Path(path)
    bag = Bag(path)
    metadata = _metadata(bag) if os.path.isdir(path) else Metadata(())
    try:
        sources = _sources(bag, metadata)
    except OSError as error:
        raise ParameterError(f"{path}: must be a bag: {error.strerror}") from None
    collected, custom, failures = _Collected(bag, vectors), dict(metadata.custom), []
    for source in sources:
        try:
            for block in _blocks(source, metadata, bag.problems, custom):
                collected.add(block)
        except (OSError, *DAMAGE_ERRORS) as error:
            failures.append(f"{source.name} cannot be read: {error}")
    if len(failures) == len(sources) and not bag.counts:
        raise ParameterError(f"{path}: must be a bag: {failures[0]}")
    bag.problems.extend(failures)
    bag.signals.update(collected.signals())
    bag.diagnostics.extend(collected.diagnostics())
    bag.changes.extend(collected.changes())
    bag.facts.update(facts_of(custom))
    return bag


def _metadata(bag: Bag) -> Metadata:
    """Return the metadata; if missing, as for an empty bag."""
    try:
        return read_metadata(bag.path)
    except MetadataError as error:
        is_there = (bag.path / METADATA).exists()
        reason = str(error).removeprefix(f"{bag.path / METADATA}: ")
        missing = "is missing: the recording was cut off"
        bag.problems.append(f"{METADATA} {f'is not read: {reason}' if is_there else missing}")
        return Metadata(())


def _sources(bag: Bag, metadata: Metadata) -> list[Path]:
    """Return the files with messages, in order."""
    path = bag.path
    if not os.path.isdir(path):
        path.stat()
        if not (is_storage(path) and os.path.isfile(path)):
            raise ParameterError(f"{path}: must be a bag's folder, or a .mcap or .db3 file")
        return [path]
    # After an interruption, the metadata lack some files of a recording.
    found = storage_files(path)
    if not found:
        raise ParameterError(f"{path}: {MUST_BE}")
    named = [path / file.name for file in metadata.files]
    missing = [f"{file.name} is missing" for file in named if not os.path.isfile(file)]
    bag.problems.extend(missing)
    first = [file for file in named if file in found]
    return first + [file for file in found if file not in first]


def _blocks(
    source: Path, metadata: Metadata, problems: list[str], custom: dict[str, str]
) -> Iterator[Block]:
    """Yield the messages of a file, and add its custom data."""
    if source.suffix == COMPRESSED:
        with TemporaryDirectory(prefix="haptic_accel-") as folder:
            whole = decompressed_file(source, Path(folder))
            yield from _blocks(whole, metadata, problems, custom)
        return
    if source.suffix == MCAP:
        mcap = McapFile(source)
        blocks = mcap.blocks()
    else:
        blocks = _foreign_blocks(source)
    if metadata.compression_mode == "message":
        allowance = Allowance(source)
        blocks = (_decompressed(block, allowance) for block in blocks)
    yield from blocks
    if source.suffix != MCAP:
        return
    if not custom:
        custom |= mcap.custom_data
    problems += mcap.problems
    if mcap.unfinished:
        problems.append(mcap.unfinished)


def _foreign_blocks(source: Path) -> Iterator[Block]:
    """Yield the messages of a file in another format than MCAP, by topic."""
    rows: dict[tuple[str, str], list[tuple[int, bytes]]] = defaultdict(list)
    try:
        _check_tables(source)
        with Reader(source) as reader:
            for connection, received, data in reader.messages():
                rows[connection.topic, connection.msgtype].append((received, bytes(data)))
    except Exception as error:
        # For damaged files the readers of rosbags raise arbitrary errors.
        raise ValueError(" ".join(str(error).split())) from None
    for (topic, kind), messages in rows.items():
        times, contents = zip(*messages, strict=True)
        yield _joined(topic, kind, np.array(times, np.int64), contents)


def _check_tables(source: Path) -> None:
    """Reject a database with computed rows, which may be endless."""
    with closing(sqlite3.connect(f"{source.absolute().as_uri()}?mode=ro", uri=True)) as database:
        rows = database.execute("SELECT type, name, sql FROM sqlite_master").fetchall()
        for kind, name, statement in rows:
            words = str(statement).upper()
            is_stored = kind in ("table", "index") and not words.startswith("CREATE VIRTUAL")
            columns = "SELECT 1 FROM pragma_table_xinfo(?) WHERE hidden != 0"
            if not is_stored or database.execute(columns, (name,)).fetchone():
                raise ValueError("it has computed rows, which are not allowed")


def _decompressed(block: Block, allowance: Allowance) -> Block:
    """Return a decompressed block, for messages that rosbag2 compressed one by one."""
    contents = []
    for start, end in zip(block.starts.tolist(), block.ends.tolist(), strict=True):
        contents.append(decompressed_message(block.bytes[start:end].tobytes()))
        allowance.spend(len(contents[-1]))
    return _joined(block.topic, block.type, block.received, contents)


def _joined(topic: str, kind: str, received: IntArray, contents: Sequence[bytes]) -> Block:
    lengths = np.array([len(content) for content in contents], dtype=np.int64)
    ends, joined = np.cumsum(lengths), np.frombuffer(b"".join(contents), np.uint8)
    return Block(topic, kind, received, joined, ends - lengths, ends)


class _Collected:
    """Messages read so far."""

    def __init__(self, bag: Bag, vectors: Collection[str] | None) -> None:
        self._bag = bag
        self._vectors = vectors
        # Stamps, times and values of each topic, as bytes, which grow in place; arrays would need
        # a copy.
        self._columns: dict[str, tuple[bytearray, ...]] = {}
        # With the node's namespace, as all graphs of a ROS domain publish to the same two topics.
        self._diagnostics: list[tuple[str, Diagnosis]] = []
        self._changes: list[tuple[str, Change]] = []
        self._namespace: str | None = None

    def add(self, block: Block) -> None:
        """Add a block of messages."""
        topic = block.topic
        self._bag.counts[topic] += len(block.received)
        namespace, name = _split(topic)
        if topic.endswith(f"/{_EVENTS}") and block.type == _EVENTS_TYPE:
            self._add_changes(block)
        elif topic.endswith(f"/{_REPORTS}") and block.type == DIAGNOSTICS.type:
            self._add_diagnostics(block)
        elif name and self._is_ours(namespace):
            self._add_signal(name, block)

    def diagnostics(self) -> Iterator[Diagnosis]:
        """Yield the reports of the graph's nodes."""
        return (said for place, said in self._diagnostics if self._namespace in (None, place))

    def changes(self) -> Iterator[Change]:
        """Yield the parameter changes of the graph."""
        return (change for place, change in self._changes if self._namespace in (None, place))

    def signals(self) -> dict[str, Signal]:
        """Return the collected signals."""
        found = {}
        for name, (stamps, received, values) in self._columns.items():
            times = np.frombuffer(stamps, np.int64), np.frombuffer(received, np.int64)
            found[name] = Signal(*times, np.frombuffer(values).reshape(-1, 3))
        return found

    def _is_ours(self, namespace: str) -> bool:
        """Return whether a namespace is the bag's first graph's; other graphs are ignored."""
        if self._namespace is None:
            self._namespace = namespace
        if namespace != self._namespace:
            self._once(f"topics below {namespace or '/'} belong to another graph and are not read")
        return namespace == self._namespace

    def _add_signal(self, name: str, block: Block) -> None:
        if block.type != _SIGNALS[name].type:
            self._once(f"{block.topic} is {block.type}, not {_SIGNALS[name].type}: it is not read")
            return
        stamps, values, formed = unpack_stamped_vectors(block.bytes, block.starts, block.ends)
        if not formed.all():
            self._once(f"{block.topic}: malformed messages are not read")
        if not formed.any():
            return
        columns = self._columns.setdefault(name, (bytearray(), bytearray(), bytearray()))
        columns[0].extend(stamps.tobytes())
        if self._vectors is None:
            columns[1].extend(block.received[formed].tobytes())
        if self._vectors is None or name in self._vectors:
            columns[2].extend(values.tobytes())

    def _add_diagnostics(self, block: Block) -> None:
        # Before 0.2.0, a topic in the graph's namespace, with the node's name only.
        below = block.topic.removesuffix(f"/{_REPORTS}")
        for received, message in self._decoded(block):
            for status in message.status:
                values = {pair.key: pair.value for pair in status.values}
                namespace, node = reporter(status.name)
                said = Diagnosis(received, node, status.message, values)
                self._diagnostics.append((below or namespace, said))

    def _add_changes(self, block: Block) -> None:
        for received, message in self._decoded(block):
            namespace, _, node = message.node.rpartition("/")
            for changed in (*message.new_parameters, *message.changed_parameters):
                value = getattr(changed.value, _VALUES.get(changed.value.type, ""), None)
                value = value.tolist() if isinstance(value, np.ndarray) else value
                change = Change(received, node, changed.name, value)
                self._changes.append((namespace, change))

    def _decoded(self, block: Block) -> Iterator[tuple[int, Any]]:
        rows = (block.received.tolist(), block.starts.tolist(), block.ends.tolist())
        for received, start, end in zip(*rows, strict=True):
            try:
                data = block.bytes[start:end].tobytes()
                yield received, _types().deserialize_cdr(data, block.type)
            except Exception as error:
                # Bytes of other messages cause arbitrary errors.
                self._once(f"{block.topic}: a message cannot be read: {error}")

    def _once(self, text: str) -> None:
        problem = " ".join(text.split())
        if problem not in self._bag.problems and len(self._bag.problems) < MOST_PROBLEMS:
            self._bag.problems.append(problem)


@cache
def _types() -> Typestore:
    # The store compiles a reader for each type, once.
    return get_typestore(Stores.ROS2_JAZZY)


def _split(topic: str) -> tuple[str, str]:
    """Return the namespace and the name in `_SIGNALS` of a graph's topic."""
    name = next((name for name in _SIGNALS if topic.endswith(f"/{name}")), "")
    return (topic.removesuffix(f"/{name}") if name else ""), name
