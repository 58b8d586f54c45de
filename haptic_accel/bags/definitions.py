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

"""Type definitions stored in a bag, so that it can be read without the types installed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

from rosbags import interfaces
from rosbags.interfaces import Connection, Qos
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


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
    """Return the known types, whose readers are compiled once."""
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
    """Yield all texts in nested tuples and lists; these include type names."""
    if isinstance(parsed, str):
        yield parsed
    elif isinstance(parsed, (tuple, list)):
        for part in parsed:
            yield from _names(part)
