# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Reader of the graph's bags: signals as arrays, metadata.

Damaged bags and bags of other programs are read as far as possible. The result lists the missing
parts.
"""

from __future__ import annotations

import math
import os
import sqlite3
from collections import Counter, defaultdict
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np

from haptic_accel.bags import file_order
from haptic_accel.bags import folder as folders
from haptic_accel.bags.compression import ZSTD, Allowance, decompressed_file, decompressed_message
from haptic_accel.bags.mcap import DAMAGE_ERRORS, MOST_PROBLEMS, Block, McapFile
from haptic_accel.bags.metadata import Metadata, MetadataError, read_metadata, types_store
from haptic_accel.bags.timeline import Arrivals, Timeline, timeline
from haptic_accel.bags.trial_metadata import PARAMETERS, read_custom_data, read_description
from haptic_accel.core import sampling, topics
from haptic_accel.core.axes import ACTUATOR_AXES, NAMES, Axes
from haptic_accel.core.cdr import unpack_stamped_vectors
from haptic_accel.core.model import FloatArray
from haptic_accel.core.parameters import ParameterError, one_line, warn_once

MOST_MESSAGES = 500_000
"""Maximum number of messages in a part of a bag: 30 MB, and three times as much during sorting."""

_EVENTS = "parameter_events"
_EVENTS_TYPE = "rcl_interfaces/msg/ParameterEvent"
_SIGNALS = {topic.name: topic for topic in (*topics.SIGNALS, topics.CONTACT_FORCE)}
_REPORTS = "diagnostics"
_APPLIED = ("master_device", "compensator", "identifier")  # nodes that know the actuator's latency

# Fields of rcl_interfaces/msg/ParameterValue by the type of the value, from 1 on.
_TYPES = "bool integer double string byte_array bool_array integer_array double_array string_array"
_VALUES = {number: f"{name}_value" for number, name in enumerate(_TYPES.split(), start=1)}


@dataclass(frozen=True)
class Signal:
    """Stamped vectors of one topic, in order of time.

    `received` and `values` are empty if `read_bag` was called without them.

    Attributes
    ----------
    stamps, received : ndarray of int64, shape (n,)
        Times of the samples, and recording times of their messages; system time, ns.
    values : ndarray, shape (n, 3)
        Vectors in SI units.
    """

    stamps: sampling.IntArray
    received: sampling.IntArray
    values: FloatArray

    def on_grid(
        self, start: int, rate: float, length: int, axes: Axes = ACTUATOR_AXES
    ) -> tuple[FloatArray, sampling.BoolArray]:
        """Return the components along specified axes on a grid, and a mask of existing samples.

        The components have shape (n,) for one axis, and (n, k) for several. The parameters are
        those of `core.sampling.grid_indices` and `core.sampling.on_grid`.
        """
        where = sampling.grid_indices(self.stamps, start, rate)
        first, *others = axes.indices
        along = self.values[:, [first, *others] if others else first]
        return sampling.on_grid(where, along, length)


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


_Item = TypeVar("_Item", Diagnosis, Change)
_Kind = TypeVar("_Kind")


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
    metadata : dict
        Metadata stored by the recorder: ``version``, ``arguments``, ``parameters``, ``host``.
        Otherwise ``parameters`` as described or declared by the graph's nodes in the bag; empty
        for bags of other programs.
    counts : dict
        Number of messages by full topic name.
    problems : list of str
        Unreadable parts, one line each.
    files : list of str
        Names of the recording's files in order.
    """

    path: Path
    signals: dict[str, Signal] = field(default_factory=dict)
    diagnostics: list[Diagnosis] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    metadata: dict[str, Any] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)
    files: list[str] = field(default_factory=list)

    @property
    def arguments(self) -> dict[str, Any]:
        """Arguments of the graph; empty if the bag states none."""
        stated = self.metadata.get("arguments")
        return stated if isinstance(stated, dict) else {}

    @property
    def stated_rate(self) -> float | None:
        """Sampling rate that the bag states, Hz."""
        stated = self.arguments.get("rate")
        if isinstance(stated, (int, float)) and 0 < stated < math.inf:
            return float(stated)
        return None

    @property
    def latency(self) -> int | None:
        """Delay from sample to force, in samples.

        The delay is 0 for forces applied on arrival, as in older bags with arguments but without a
        latency, and None if the bag states neither.
        """
        arguments, nodes = self.metadata.get("arguments"), self.metadata.get(PARAMETERS)
        own = [nodes.get(name) for name in _APPLIED] if isinstance(nodes, dict) else []
        for stated in (arguments, *own):
            found = stated.get("latency") if isinstance(stated, dict) else None
            if isinstance(found, int) and 0 <= found <= sampling.HIGHEST_LATENCY:
                return found
        return 0 if isinstance(arguments, dict) else None

    @property
    def axes(self) -> Axes:
        """Axes of the vibration: the compensator's axes, or the axes with any vibration."""
        nodes = self.metadata.get("parameters")
        compensator = nodes.get("compensator") if isinstance(nodes, dict) else None
        stated = compensator.get("axes") if isinstance(compensator, dict) else None
        if isinstance(stated, str):
            with suppress(ParameterError):
                return Axes.parsed(stated)
        acted = [
            self.signals[topic.name].values
            for topic in (topics.DESIRED_ACCELERATION, topics.ACTUATOR_FORCE)
            if topic.name in self.signals
        ]
        names = tuple(
            name
            for axis, name in enumerate(NAMES)
            if any((np.abs(values[:, axis]) > 0.0).any() for values in acted)
        )
        return Axes(names) if names else ACTUATOR_AXES

    def coupled(self, arm: topics.ArmTopics) -> list[tuple[int, int]]:
        """Return start and end of each period in which an arm was coupled, ns.

        The list is empty without forces of the arm's motors; see
        `core.sampling.coupled_stretches`.
        """
        forces, samples = (self.signals.get(t.name) for t in (arm.arm_force, arm.acceleration))
        if forces is None:
            return []
        stamps = np.array([], np.int64) if samples is None else np.sort(samples.stamps)
        return sampling.coupled_stretches(forces.stamps, forces.values, stamps)


def read_bag(path: Path | str, vectors: Collection[str] | None = None) -> Bag:
    """Read a bag; if its folder has several recordings, read the first.

    Parameters
    ----------
    path : Path or str
        Folder of a bag, or one of its files.
    vectors : collection of str, optional
        Names of the topics whose vectors are needed. Other topics keep only stamps, without
        recording times, which takes a fifth of the memory. Default: all topics with all data.

    Raises
    ------
    ParameterError
        The path is not a bag, or the bag is unreadable.
    """
    return read_bags(path, vectors)[0]


def read_bags(path: Path | str, vectors: Collection[str] | None = None) -> list[Bag]:
    """Read each recording in the folder of a bag, usually one, as `read_bag` does."""
    path = Path(path)
    whole = Bag(path)
    problems = whole.problems
    metadata, sources = _contents(whole)
    collected, failures, files = _Collected(whole, vectors), [], []
    before = len(problems)
    for source in sources:
        files.append(collected.begin(source.name, is_alone=len(sources) == 1))
        try:
            for block in _blocks(source, problems, files[-1].custom):
                collected.add(block)
        except DAMAGE_ERRORS as error:
            failures.append(f"{source.name} cannot be read: {error}")
    if len(failures) == len(sources) and not any(file.messages for file in files):
        raise ParameterError(f"{path}: must be a bag: {failures[0]}")
    is_whole = len(problems) == before and not failures
    problems += file_order.contradictions(metadata, files) if is_whole else failures
    listed = [file.name for file in metadata.files]
    return [
        collected.arranged(each) for each in file_order.recordings(files, listed, metadata.custom)
    ]


def read_parts(path: Path, most: int = MOST_MESSAGES) -> Iterator[Bag]:
    """Yield a bag's contents in parts of bounded memory, each sorted by time.

    Files are read in the order of their names. The caller has to check whether the parts follow
    each other in time and belong to one recording; `read_bags` checks the whole folder.

    Parameters
    ----------
    path : Path
        Folder of a bag, or one of its files.
    most : int
        Number of messages after which a part ends.

    Raises
    ------
    ParameterError
        The path is not a bag.
    ValueError
        A file cannot be read; may be any of `mcap.DAMAGE_ERRORS`.
    """
    whole = Bag(path)
    metadata, sources = _contents(whole)
    namespace: str | None = None
    for source in sources:
        custom = dict(metadata.custom)
        part = _Collected(whole, None, namespace)
        for block in _blocks(source, whole.problems, custom):
            part.add(block)
            if part.file.messages >= most:
                yield part.arranged(*file_order.recordings([part.file], (), custom))
                namespace = part.namespace
                part = _Collected(whole, None, namespace)
        yield part.arranged(*file_order.recordings([part.file], (), custom))
        namespace = part.namespace


def messages_of(path: Path, kinds: Collection[str]) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, recording time in ns and content of all messages of some types.

    Parameters
    ----------
    path : Path
        Folder of a bag, or one of its files.
    kinds : collection of str
        Message types such as ``sensor_msgs/msg/Image``.

    Raises
    ------
    ParameterError
        The path is not a bag, or one of the messages is damaged.
    """
    whole = Bag(path)
    for source in _contents(whole)[1]:
        for block in _blocks(source, whole.problems, {}):
            if block.type not in kinds:
                continue
            rows = zip(block.received.tolist(), block.starts, block.ends, strict=True)
            for received, start, end in rows:
                data = block.bytes[start:end].tobytes()
                try:
                    message = types_store().deserialize_cdr(data, block.type)
                except Exception as error:  # any kind, as for `_Collected`
                    raise ParameterError(
                        f"{path}: {block.topic}: a message cannot be read: {one_line(error)}"
                    ) from None
                yield block.topic, received, message


def read_bag_with_warnings(path: Path | str) -> Bag:
    """Read a complete bag by `read_bag`, and log its problems as warnings."""
    bag = read_bag(path)
    for problem in bag.problems:
        warn_once(f"{bag.path.absolute()}: {problem}")
    return bag


def _contents(bag: Bag) -> tuple[Metadata, list[Path]]:
    """Return a bag's metadata, and its files with messages in order."""
    try:
        metadata = _metadata(bag) if os.path.isdir(bag.path) else Metadata(())
        return metadata, _sources(bag, metadata)
    except OSError as error:
        raise ParameterError(f"{bag.path}: must be a bag: {error.strerror}") from None


def _metadata(bag: Bag) -> Metadata:
    """Return the metadata, or those of an empty bag if they cannot be read."""
    try:
        return read_metadata(bag.path)
    except MetadataError as error:
        is_there = (bag.path / folders.METADATA).exists()
        reason = str(error).removeprefix(f"{bag.path / folders.METADATA}: ")
        missing = "is missing: its files are read without it"
        bag.problems.append(
            f"{folders.METADATA} {f'is not read: {reason}' if is_there else missing}"
        )
        return Metadata(())


def _sources(bag: Bag, metadata: Metadata) -> list[Path]:
    """Return the files with messages, in order."""
    path = bag.path
    if not os.path.isdir(path):
        path.stat()
        if not (folders.is_storage(path) and os.path.isfile(path)):
            raise ParameterError(f"{path}: must be a bag's folder, or a .mcap or .db3 file")
        return [path]
    # After an interruption, the metadata lack some files of a recording.
    found = folders.storage_files(path)
    if not found:
        raise ParameterError(f"{path}: {folders.MUST_BE}")
    missing = (file.name for file in metadata.files if not os.path.isfile(path / file.name))
    bag.problems.extend(f"{name} is missing" for name in missing)
    return found


def _blocks(source: Path, problems: list[str], custom: dict[str, str]) -> Iterator[Block]:
    """Yield the messages of a file, and add its custom data; raise one of `DAMAGE_ERRORS`."""
    try:
        yield from _stored_blocks(source, problems, custom)
    except OSError as error:
        raise ValueError(error.strerror or str(error)) from None


def _stored_blocks(source: Path, problems: list[str], custom: dict[str, str]) -> Iterator[Block]:
    if source.suffix == folders.COMPRESSED:
        with TemporaryDirectory(prefix="haptic_accel-") as folder:
            whole = decompressed_file(source, Path(folder))
            yield from _blocks(whole, problems, custom)
        return
    if source.suffix == folders.MCAP:
        mcap = McapFile(source)
        blocks = mcap.blocks()
    else:
        for end in ("-wal", "-journal"):  # SQLite's pending messages
            if os.path.exists(f"{source}{end}") and os.path.getsize(f"{source}{end}"):
                advice = "sqlite3 adds its messages when it opens the file once"
                problems.append(f"{source.name}{end} is not read: {advice}")
        blocks = _foreign_blocks(source)
    allowance = Allowance(source)
    for block in blocks:
        yield _decompressed(block, allowance) if _is_compressed(block) else block
    if source.suffix != folders.MCAP:
        return
    custom |= mcap.custom_data
    problems += mcap.problems
    if mcap.unfinished:
        is_open = folders.is_being_written(source)
        still = f"{source.name} is still being written: read as far as it is there"
        problems.append(still if is_open else mcap.unfinished)


def _foreign_blocks(source: Path) -> Iterator[Block]:
    """Yield the messages of a file in another format than MCAP, by topic."""
    rows: dict[tuple[str, str], list[tuple[int, int, bytes]]] = defaultdict(list)
    address = f"{source.absolute().as_uri()}?mode=ro&immutable=1"
    try:
        with closing(sqlite3.connect(address, uri=True)) as database:
            _check_tables(database)
            for topic, kind, *message in database.execute(_IN_ORDER):
                time, offset, data = message
                rows[str(topic), str(kind)].append((int(time), int(offset), bytes(data)))
    except sqlite3.Error as error:
        raise ValueError(" ".join(str(error).split())) from None
    for (topic, kind), messages in rows.items():
        times, offsets, contents = zip(*messages, strict=True)
        order = np.array(offsets, np.int64)
        yield _joined(topic, kind, np.array(times, np.int64), order, contents)


_IN_ORDER = (
    "SELECT topics.name, topics.type, messages.timestamp, messages.id, messages.data"
    " FROM messages JOIN topics ON messages.topic_id = topics.id ORDER BY messages.id"
)
"""Query of the messages in order of arrival; the readers of rosbags sort them by time."""


def _check_tables(database: sqlite3.Connection) -> None:
    """Reject a database with computed rows, whose number may be unlimited."""
    for kind, name, statement in database.execute("SELECT type, name, sql FROM sqlite_master"):
        sql = str(statement).upper()
        is_stored = kind in ("table", "index") and not sql.startswith("CREATE VIRTUAL")
        columns = "SELECT 1 FROM pragma_table_xinfo(?) WHERE hidden != 0"
        if not is_stored or database.execute(columns, (name,)).fetchone():
            raise ValueError("it has computed rows, which are not allowed")


def _is_compressed(block: Block) -> bool:
    """Return whether messages are compressed one by one, independent of metadata.yaml.

    A message begins with a zero in every encoding of CDR.
    """
    start = int(block.starts[0]) if len(block.starts) else 0
    return block.bytes[start : start + len(ZSTD)].tobytes() == ZSTD


def _decompressed(block: Block, allowance: Allowance) -> Block:
    """Return a decompressed block, for messages that rosbag2 compressed one by one."""
    contents = []
    for start, end in zip(block.starts.tolist(), block.ends.tolist(), strict=True):
        contents.append(decompressed_message(block.bytes[start:end].tobytes()))
        allowance.spend(len(contents[-1]))
    return _joined(block.topic, block.type, block.received, block.offsets, contents)


def _joined(
    topic: str,
    kind: str,
    received: sampling.IntArray,
    offsets: sampling.IntArray,
    contents: Sequence[bytes],
) -> Block:
    lengths = np.array([len(content) for content in contents], dtype=np.int64)
    ends, joined = np.cumsum(lengths), np.frombuffer(b"".join(contents), np.uint8)
    return Block(topic, kind, received, joined, ends - lengths, ends, offsets)


def news(changes: Sequence[Change]) -> Iterator[Change]:
    """Yield the changes of values; nodes also repeat unchanged parameters."""
    known: dict[tuple[str, str], str] = {}
    for change in changes:
        key, value = (change.node, change.parameter), repr(change.value)
        if known.get(key) != value:
            known[key] = value
            yield change


class _Collected:
    """Messages read so far.

    Attributes
    ----------
    file : FileContent
        File that is being read.
    namespace : str or None
        Namespace of the first graph found; other graphs are ignored.
    """

    def __init__(
        self, bag: Bag, vectors: Collection[str] | None, namespace: str | None = None
    ) -> None:
        self._bag = bag
        self._vectors = vectors
        self.file = file_order.FileContent("")
        self.namespace = namespace
        self._before = 0  # offset of the file's beginning
        # Stamps, offsets, marks, times and values of each topic, as byte arrays, which can grow
        # without a copy.
        self._columns: dict[str, tuple[bytearray, ...]] = {}
        # The node's namespace is kept, as all graphs of a ROS domain publish to the same two
        # topics.
        self._diagnostics: list[tuple[str, int, Diagnosis]] = []
        self._changes: list[tuple[str, int, Change]] = []
        self._stated: list[tuple[str, int, Change]] = []
        self._described: list[tuple[str, int, dict[str, Any]]] = []
        self._files, self._is_alone = 0, True

    def begin(self, name: str, *, is_alone: bool) -> file_order.FileContent:
        """Start a file; return its content, to which the next blocks are added."""
        self._before = self._files << file_order.FILE_BITS
        self._files += 1
        self.file = file_order.FileContent(name)
        self._is_alone = is_alone
        return self.file

    def add(self, block: Block) -> None:
        """Add a block of messages."""
        topic = block.topic
        self.file.count(topic, block.received)
        namespace, name = _split(topic)
        if topic.endswith(f"/{_EVENTS}") and block.type == _EVENTS_TYPE:
            self._add_changes(block)
        elif (
            topic.endswith(f"/{topics.DESCRIPTION.name}") and block.type == topics.DESCRIPTION.type
        ):
            self._add_descriptions(block)
        elif topic.endswith(f"/{_REPORTS}") and block.type == topics.DIAGNOSTICS.type:
            self._add_diagnostics(block)
        elif name and self._is_ours(namespace):
            self._add_signal(name, block)

    def arranged(self, used: file_order.Recording) -> Bag:
        """Return the collected messages of a recording, in order of time."""
        counts = sum((file.counts for file in used.files), Counter[str]())
        names = [file.name for file in used.files]
        bag = Bag(self._bag.path, counts=counts, files=names)
        bag.problems.extend([*self._bag.problems, *used.notes])
        bag.metadata.update(self._stated_metadata(used) | read_custom_data(used.custom))
        sampled, of_files = {}, {}
        for name, (stamps, arrivals, marks, *_) in self._columns.items():
            moved = used.moved(np.frombuffer(arrivals, np.int64))
            if not (moved >= 0).any():
                continue
            of_files[name] = np.flatnonzero(moved >= 0)
            columns = np.frombuffer(stamps, np.int64), moved, np.frombuffer(marks, np.int64)
            sampled[name] = Arrivals(*columns)[of_files[name]]
        found = timeline(sampled, bag.stated_rate)
        bag.problems.extend(found.notes)
        for name in sampled:
            *_, received, values = self._columns[name]
            if not len(found.stamps[name]):
                continue
            chosen = of_files[name][found.chosen[name]]
            times, vectors = np.frombuffer(received, np.int64), np.frombuffer(values)
            if len(times):
                times = found.moved(times[chosen], sampled[name].offsets[found.chosen[name]])
            if len(vectors):
                vectors = vectors.reshape(-1, 3)[chosen]
            bag.signals[name] = Signal(found.stamps[name], times, vectors.reshape(-1, 3))
        bag.diagnostics.extend(self._in_time(self._diagnostics, used, found))
        bag.changes.extend(news(self._in_time(self._changes, used, found)))
        return bag

    def _stated_metadata(self, used: file_order.Recording) -> dict[str, Any]:
        """Return the graph's metadata as its nodes first described or declared them."""
        nodes: dict[str, dict[str, Any]] = {}
        for said in self._of_graph(self._stated, used)[0]:
            nodes.setdefault(said.node, {}).setdefault(said.parameter, said.value)
        found = {PARAMETERS: nodes} if nodes else {}
        for described in self._of_graph(self._described, used)[0]:
            found = described | found
        return found

    def _of_graph(
        self, items: Sequence[tuple[str, int, _Kind]], used: file_order.Recording
    ) -> tuple[list[_Kind], sampling.IntArray]:
        """Return the graph's items in the used files in order of arrival, and their offsets."""
        ours = [rest for below, *rest in items if self.namespace in (None, below)]
        offsets = used.moved(np.array([offset for offset, _ in ours], np.int64))
        order = np.argsort(offsets, kind="stable")
        order = order[offsets[order] >= 0]
        return [ours[index][1] for index in order.tolist()], offsets[order]

    def _in_time(
        self, items: Sequence[tuple[str, int, _Item]], used: file_order.Recording, found: Timeline
    ) -> list[_Item]:
        """Return the graph's reports or changes in order of time, without duplicates."""
        ours, offsets = self._of_graph(items, used)
        times = found.moved(np.array([item.received for item in ours], np.int64), offsets)
        moved: dict[str, _Item] = {}
        for index in np.argsort(times, kind="stable").tolist():
            item = replace(ours[index], received=int(times[index]))
            moved.setdefault(repr(item), item)
        return list(moved.values())

    def _is_ours(self, namespace: str) -> bool:
        """Return whether a namespace is the bag's first graph's; other graphs are ignored."""
        if self.namespace is None:
            self.namespace = namespace
        if namespace != self.namespace:
            self._once(f"topics below {namespace or '/'} belong to another graph and are not read")
        return namespace == self.namespace

    def _add_signal(self, name: str, block: Block) -> None:
        if block.type != _SIGNALS[name].type:
            self._once(f"{block.topic} is {block.type}, not {_SIGNALS[name].type}: it is not read")
            return
        stamps, values, formed = unpack_stamped_vectors(block.bytes, block.starts, block.ends)
        if not formed.all():
            self._once(f"{block.topic}: malformed messages are not read")
        if not formed.any():
            return
        columns = self._columns.setdefault(name, tuple(bytearray() for _ in range(5)))
        offsets, marks = self._before + block.offsets[formed], file_order.marks_of(values)
        columns[0].extend(stamps.tobytes())
        columns[1].extend(offsets.tobytes())
        columns[2].extend(marks.tobytes())
        if self._vectors is None:
            columns[3].extend(block.received[formed].tobytes())
        if self._vectors is None or name in self._vectors:
            columns[4].extend(values.tobytes())
        if not self._is_alone:
            self.file.add(name, Arrivals(stamps, offsets, marks))

    def _add_diagnostics(self, block: Block) -> None:
        # Before 0.2.0, diagnostics were in the graph's namespace, with the node's name only.
        below = block.topic.removesuffix(f"/{_REPORTS}")
        for received, offset, message in self._decoded(block):
            for status in message.status:
                values = {pair.key: pair.value for pair in status.values}
                namespace, node = topics.reporter(status.name)
                said = Diagnosis(received, node, status.message, values)
                self._diagnostics.append((below or namespace, offset, said))

    def _add_changes(self, block: Block) -> None:
        for received, offset, message in self._decoded(block):
            namespace, _, node = message.node.rpartition("/")
            declared = {parameter.name for parameter in message.new_parameters}
            for changed in (*message.new_parameters, *message.changed_parameters):
                value = getattr(changed.value, _VALUES.get(changed.value.type, ""), None)
                value = value.tolist() if isinstance(value, np.ndarray) else value
                change = Change(received, node, changed.name, value)
                self._changes.append((namespace, offset, change))
                if changed.name in declared:
                    self._stated.append((namespace, offset, change))

    def _add_descriptions(self, block: Block) -> None:
        """Add the nodes' descriptions of their parameters."""
        namespace = block.topic.removesuffix(f"/{topics.DESCRIPTION.name}")
        for received, offset, message in self._decoded(block):
            try:
                described = read_description(message.data)
            except ValueError as error:
                self._once(f"{block.topic}: a message is not read: {error}")
                continue
            self._described.append((namespace, offset, described))
            stated = [
                (namespace, offset, Change(received, node, name, value))
                for node, own in described[PARAMETERS].items()
                for name, value in own.items()
            ]
            self._stated += stated
            self._changes += stated

    def _decoded(self, block: Block) -> Iterator[tuple[int, int, Any]]:
        offsets = self._before + block.offsets
        rows = (each.tolist() for each in (block.received, offsets, block.starts, block.ends))
        for received, offset, start, end in zip(*rows, strict=True):
            try:
                data = block.bytes[start:end].tobytes()
                yield received, offset, types_store().deserialize_cdr(data, block.type)
            except Exception as error:
                # Bytes of another message type cause arbitrary errors.
                self._once(f"{block.topic}: a message cannot be read: {error}")

    def _once(self, text: str) -> None:
        problem = " ".join(text.split())
        if problem not in self._bag.problems and len(self._bag.problems) < MOST_PROBLEMS:
            self._bag.problems.append(problem)


def _split(topic: str) -> tuple[str, str]:
    """Return the namespace and the name in `_SIGNALS` of a graph's topic."""
    name = next((name for name in _SIGNALS if topic.endswith(f"/{name}")), "")
    return (topic.removesuffix(f"/{name}") if name else ""), name
