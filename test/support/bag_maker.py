# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Maker of bags with known content for tests, without a graph.

`BagContent` and `write_bag` make a bag as a graph records it. At a lower level, `write_messages`
writes any messages in any format of rosbags, and `record_messages` in the recorder's format.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from haptic_accel.bags.metadata import connection
from haptic_accel.bags.recording_options import RecordingOptions
from haptic_accel.bags.trial_metadata import PREFIX
from haptic_accel.bags.writing import BagFiles
from haptic_accel.core import topics
from haptic_accel.core.axes import ACTUATOR_AXIS
from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import Topic
from haptic_accel.core.trial import Trial

START = 1_700_000_000_000_000_000
"""First stamp, ns."""

NANOSECONDS = 1_000_000_000

STRING = "std_msgs/msg/String"
CHANGED = "rcl_interfaces/msg/ParameterEvent"
TEXT, INTEGER = 4, 2
"""Values in rcl_interfaces/msg/ParameterType."""

_TYPES = get_typestore(Stores.ROS2_JAZZY)

FloatArray = npt.NDArray[np.float64]


class Message(NamedTuple):
    """Recorded message: topic with slash, type, time of reception in ns, and bytes."""

    topic: str
    kind: str
    received: int
    data: bytes


def vector_bytes(
    kind: str, stamp: int, frame: str, vector: Sequence[float], *, little_endian: bool = True
) -> bytes:
    """Return a vector's stamped message, packed by rosbags instead of this package.

    All other fields of the message are not zero.
    """
    kinds: Any = _TYPES.types
    if kind.endswith("PoseStamped"):
        point = kinds["geometry_msgs/msg/Point"](*vector)
        turn = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        body = kinds["geometry_msgs/msg/Pose"](point, turn)
    else:
        first = kinds["geometry_msgs/msg/Vector3"](*vector)
        rest = kinds["geometry_msgs/msg/Vector3"](7.0, 8.0, 9.0)
        body = kinds[kind.replace("Stamped", "")](first, rest)
    message = kinds[kind](_header(stamp, frame), body)
    return bytes(_TYPES.serialize_cdr(message, kind, little_endian=little_endian))


def diagnostics_bytes(stamp: int, node: str, message: str, values: Mapping[str, str]) -> bytes:
    """Return diagnostics with the status of one node."""
    kinds: Any = _TYPES.types
    pairs = [kinds["diagnostic_msgs/msg/KeyValue"](*pair) for pair in values.items()]
    status = kinds["diagnostic_msgs/msg/DiagnosticStatus"](0, node, message, "", pairs)
    array = kinds[topics.DIAGNOSTICS.type](_header(stamp, ""), [status])
    return bytes(_TYPES.serialize_cdr(array, topics.DIAGNOSTICS.type))


def change_bytes(
    stamp: int, node: str, name: str, given: str | int, *, declared: bool = False
) -> bytes:
    """Return the event of a node's parameter set or declared; the node has its slash."""
    kinds: Any = _TYPES.types
    is_text = isinstance(given, str)
    value = kinds["rcl_interfaces/msg/ParameterValue"](
        type=TEXT if is_text else INTEGER,
        bool_value=False,
        integer_value=0 if is_text else given,
        double_value=0.0,
        string_value=given if is_text else "",
        byte_array_value=np.empty(0, np.uint8),
        bool_array_value=np.empty(0, bool),
        integer_array_value=np.empty(0, np.int64),
        double_array_value=np.empty(0),
        string_array_value=[],
    )
    parameter = kinds["rcl_interfaces/msg/Parameter"](name, value)
    new, changed = ([parameter], []) if declared else ([], [parameter])
    event = kinds[CHANGED](_time(stamp), node, new, changed, [])
    return bytes(_TYPES.serialize_cdr(event, CHANGED))


def write_messages(
    bag: Path,
    messages: Iterable[Message],
    *,
    declared: Mapping[str, str] | None = None,
    storage: StoragePlugin = StoragePlugin.MCAP,
    compression: CompressionMode = CompressionMode.NONE,
    custom: Mapping[str, str] | None = None,
) -> Path:
    """Write messages in order by rosbags; return the bag's folder.

    Parameters
    ----------
    declared : mapping
        Types of topics declared even without messages.
    storage, compression
        Format of the bag.
    custom : mapping
        The bag's custom data.
    """
    bag.parent.mkdir(parents=True, exist_ok=True)
    writer = Writer(bag, version=9, storage_plugin=storage)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    for key, text in (custom or {}).items():
        writer.set_custom_data(key, text)
    with writer:
        connections: dict[str, Connection] = {}

        def connected(topic: str, kind: str) -> Connection:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=_TYPES)
            return connections[topic]

        for topic, kind in (declared or {}).items():
            connected(topic, kind)
        for message in messages:
            data = message.data
            writer.write(connected(message.topic, message.kind), message.received, data)
    return bag


def record_messages(
    bag: Path,
    messages: Sequence[Message],
    *,
    options: RecordingOptions | None = None,
    custom: Mapping[str, str] | None = None,
    flush_after: Collection[int] = (),
) -> BagFiles:
    """Write messages as the recorder does; return the files, which are still open.

    Parameters
    ----------
    flush_after : collection
        Indices of messages after which the files are flushed, which ends a chunk.
    """
    files = BagFiles(bag, options or RecordingOptions(), custom or {})
    kinds = {message.topic: message.kind for message in messages}
    numbered = enumerate(kinds.items(), start=1)
    added = {topic: connection(number, topic, kind, []) for number, (topic, kind) in numbered}
    for each in added.values():
        files.add(each)
    for place, message in enumerate(messages):
        files.write(added[message.topic], message.received, message.data)
        if place in flush_after:
            files.flush()
    return files


@dataclass
class BagContent:
    """Content of a bag to write.

    Attributes
    ----------
    signals : mapping
        Arrays by topic, shape (n, 3), or (n,) along the actuator's axis.
    rate : float
        Sampling rate, Hz.
    metadata : mapping
        Metadata stored by the recorder.
    changes : sequence
        Times in s with node, parameter and text.
    diagnostics : sequence
        Times in s with node, message and values.
    gap : tuple of float
        Times when the arms disengage and engage again, s.
    arms : bool
        True for forces on the master's arm, as in coupled arms.
    pull : float
        Force on the master's arm, N.
    dropped : mapping
        Indices of samples that are not written, by topic.
    start : int
        First stamp, ns.
    delay : callable
        Function from a sample's index to its recording delay, ns.
    """

    signals: Mapping[str, FloatArray]
    rate: float = 1000.0
    metadata: Mapping[str, Any] = field(default_factory=dict)
    changes: Sequence[tuple[float, str, str, str]] = ()
    diagnostics: Sequence[tuple[float, str, str, dict[str, str]]] = ()
    gap: tuple[float, float] | None = None
    arms: bool = True
    pull: float = 1.0
    dropped: Mapping[str, Collection[int]] = field(default_factory=dict)
    start: int = START
    delay: Callable[[int], int] = lambda place: 0


def meta(controller: str, surface: str, *, seed: int = 0, rate: float = 1000.0) -> dict[str, Any]:
    """Return the recorder's metadata of a graph, as far as tests read it."""
    given = {"controller": controller, "surface": surface, "seed": seed, "rate": rate}
    return {
        "version": "0.1.0",
        "arguments": {**given, "grip": "average"},
        "parameters": {
            "compensator": {"controller": controller, "high_pass_frequency": 15.0},
            "slave_device": {"simulated.surface.name": surface},
        },
        "host": {"python": "3.12"},
    }


def of_trial(trial: Trial, *, seed: int = 0) -> BagContent:
    """Return the content of a trial's bag."""
    return BagContent(
        {
            topics.TOOL_ACCELERATION.name: trial.tool_acceleration,
            topics.DESIRED_ACCELERATION.name: trial.desired_acceleration,
            topics.HANDLE_ACCELERATION.name: trial.handle_acceleration,
            topics.ACTUATOR_FORCE.name: trial.actuator_force,
        },
        trial.rate,
        meta(trial.controller, trial.surface, seed=seed, rate=trial.rate),
    )


def write_bag(path: Path, content: BagContent, *, compressed: bool = False) -> Path:
    """Write a bag, its chunks compressed if wanted; return its folder."""
    known = {topic.name: topic for topic in topics.SIGNALS}
    signals = {known[name]: values for name, values in content.signals.items()}
    if content.arms:
        longest = max((len(values) for values in signals.values()), default=0)
        signals[topics.MASTER_ARM_FORCE] = np.full(longest, content.pull)
    samples = (_samples(topic, values, content) for topic, values in signals.items())
    messages = [message for each in samples for message in each]
    for seconds, node, name, text in content.changes:
        moment = _moment(content, seconds)
        data = change_bytes(moment, f"/{node}", name, text)
        messages.append(Message("/parameter_events", CHANGED, moment, data))
    for seconds, node, said, values in content.diagnostics:
        moment = _moment(content, seconds)
        data = diagnostics_bytes(moment, node, said, values)
        messages.append(Message("/diagnostics", topics.DIAGNOSTICS.type, moment, data))
    return write_messages(
        path,
        sorted(messages, key=lambda message: message.received),
        declared={f"/{topic.name}": topic.type for topic in signals},
        compression=CompressionMode.STORAGE if compressed else CompressionMode.NONE,
        custom={
            PREFIX + name: values if isinstance(values, str) else json.dumps(values)
            for name, values in content.metadata.items()
        },
    )


def _samples(topic: Topic, values: FloatArray, content: BagContent) -> Iterator[Message]:
    if values.ndim == 1:
        along = values
        values = np.zeros((len(along), 3))
        values[:, ACTUATOR_AXIS] = along
    message = StampedVector(topic)
    dropped = set(content.dropped.get(topic.name, ()))
    gap = content.gap if topic is topics.MASTER_ARM_FORCE else None
    for place, (x, y, z) in enumerate(values.tolist()):
        seconds = place / content.rate
        if place in dropped or (gap and gap[0] <= seconds < gap[1]):
            continue
        stamp = _moment(content, seconds)
        data = message.pack(stamp, (x, y, z))
        yield Message(f"/{topic.name}", topic.type, stamp + content.delay(place), data)


def _moment(content: BagContent, seconds: float) -> int:
    return content.start + round(seconds * NANOSECONDS)


def _time(moment: int) -> Any:
    return _TYPES.types["builtin_interfaces/msg/Time"](*divmod(moment, NANOSECONDS))


def _header(moment: int, frame: str) -> Any:
    return _TYPES.types["std_msgs/msg/Header"](_time(moment), frame)
