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

"""Small bags with content that a test knows, written without a graph."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core import topics
from haptic_accel.core.topics import Topic
from haptic_accel.core.trial import Trial

START = 1_700_000_000_000_000_000
"""First stamp, ns."""

NANOSECONDS = 1_000_000_000

_TYPES = get_typestore(Stores.ROS2_JAZZY)
_DOUBLES = {"Pose": 7, "Twist": 6, "Wrench": 6, "Accel": 6}
_EVENTS = "rcl_interfaces/msg/ParameterEvent"

FloatArray = npt.NDArray[np.float64]


@dataclass
class BagContent:
    """Content of a bag to write.

    `signals` are along the actuator's axis, by topic; `changes` are moments in s with node,
    parameter and text; `diagnostics` moments with node, message and values; `gap` is when the arms
    let go, s; `dropped` are the places of samples that are not written, by topic; `start` is the
    first stamp, ns.
    """

    signals: Mapping[str, FloatArray]
    rate: float = 1000.0
    facts: Mapping[str, Any] = field(default_factory=dict)
    changes: Sequence[tuple[float, str, str, str]] = ()
    diagnostics: Sequence[tuple[float, str, str, dict[str, str]]] = ()
    gap: tuple[float, float] | None = None
    arms: bool = True
    dropped: Mapping[str, Sequence[int]] = field(default_factory=dict)
    start: int = START


def facts(controller: str, surface: str, *, seed: int = 0, rate: float = 1000.0) -> dict[str, Any]:
    """Return what the recorder stores of a graph, as far as it is looked at."""
    return {
        "version": "0.1.0",
        "arguments": {
            "controller": controller,
            "surface": surface,
            "seed": seed,
            "rate": rate,
            "grip": "average",
        },
        "parameters": {
            "compensator": {"controller": controller, "high_pass_frequency": 15.0},
            "slave_device": {"simulated.surface.name": surface},
        },
        "host": {"python": "3.12"},
    }


def of_trial(trial: Trial, *, seed: int = 0) -> BagContent:
    """Return the content of a bag that holds a trial."""
    return BagContent(
        {
            topics.TOOL_ACCELERATION.name: trial.tool_acceleration,
            topics.DESIRED_ACCELERATION.name: trial.desired_acceleration,
            topics.HANDLE_ACCELERATION.name: trial.handle_acceleration,
            topics.ACTUATOR_FORCE.name: trial.actuator_force,
        },
        trial.rate,
        facts(trial.controller, trial.surface, seed=seed, rate=trial.rate),
    )


def write_bag(path: Path, content: BagContent) -> Path:
    """Write a bag; return its folder."""
    signals = dict(content.signals)
    if content.arms:
        longest = max((len(values) for values in signals.values()), default=0)
        signals[topics.MASTER_ARM_FORCE.name] = np.ones(longest)
    path.parent.mkdir(parents=True, exist_ok=True)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for name, values in content.facts.items():
            writer.set_custom_data(f"haptic_accel.{name}", json.dumps(values))
        known = {topic.name: topic for topic in topics.SIGNALS}
        messages = [
            message
            for name, values in signals.items()
            for message in _signal(known[name], values, content)
        ]
        messages += [_change(content, change) for change in content.changes]
        messages += [_diagnosis(content, diagnosis) for diagnosis in content.diagnostics]
        connections = {
            (topic, kind): writer.add_connection(f"/{topic.lstrip('/')}", kind, typestore=_TYPES)
            for topic, kind in dict.fromkeys((topic, kind) for _, topic, kind, _ in messages)
        }
        for received, topic, kind, data in sorted(messages, key=lambda message: message[0]):
            writer.write(connections[topic, kind], received, data)
    return path


_Message = tuple[int, str, str, bytes]


def _signal(topic: Topic, values: FloatArray, content: BagContent) -> list[_Message]:
    frame = topic.frame.encode() + b"\0"
    doubles = next(number for name, number in _DOUBLES.items() if name in topic.type)
    rest = struct.pack("<I", len(frame)) + frame + b"\0" * (-(12 + len(frame)) % 8)
    found = []
    dropped = set(content.dropped.get(topic.name, ()))
    for index, value in enumerate(values.tolist()):
        if index in dropped:
            continue
        seconds = index / content.rate
        arm = topic is topics.MASTER_ARM_FORCE
        if arm and content.gap and content.gap[0] <= seconds < content.gap[1]:
            continue
        stamp = content.start + round(seconds * NANOSECONDS)
        data = b"\0\1\0\0" + struct.pack("<iI", *divmod(stamp, NANOSECONDS)) + rest
        data += struct.pack(f"<{doubles}d", 0.0, 0.0, value, *[0.0] * (doubles - 3))
        found.append((stamp, topic.name, topic.type, data))
    return found


def _moment(content: BagContent, seconds: float) -> int:
    return content.start + round(seconds * NANOSECONDS)


def _time(moment: int) -> Any:
    return _TYPES.types["builtin_interfaces/msg/Time"](*divmod(moment, NANOSECONDS))


def _change(content: BagContent, change: tuple[float, str, str, str]) -> _Message:
    seconds, node, name, text = change
    kinds = _TYPES.types
    value = kinds["rcl_interfaces/msg/ParameterValue"](
        type=4,
        bool_value=False,
        integer_value=0,
        double_value=0.0,
        string_value=text,
        byte_array_value=np.empty(0, np.uint8),
        bool_array_value=np.empty(0, bool),
        integer_array_value=np.empty(0, np.int64),
        double_array_value=np.empty(0),
        string_array_value=[],
    )
    parameter = kinds["rcl_interfaces/msg/Parameter"](name, value)
    moment = _moment(content, seconds)
    event = kinds[_EVENTS](_time(moment), f"/{node}", [], [parameter], [])
    return moment, "parameter_events", _EVENTS, bytes(_TYPES.serialize_cdr(event, _EVENTS))


def _diagnosis(content: BagContent, diagnosis: tuple[float, str, str, dict[str, str]]) -> _Message:
    seconds, node, message, values = diagnosis
    kinds = _TYPES.types
    moment = _moment(content, seconds)
    pairs = [kinds["diagnostic_msgs/msg/KeyValue"](*pair) for pair in values.items()]
    status = kinds["diagnostic_msgs/msg/DiagnosticStatus"](0, node, message, "", pairs)
    header = kinds["std_msgs/msg/Header"](_time(moment), "")
    array = kinds[topics.DIAGNOSTICS.type](header, [status])
    data = bytes(_TYPES.serialize_cdr(array, topics.DIAGNOSTICS.type))
    return moment, topics.DIAGNOSTICS.name, topics.DIAGNOSTICS.type, data
