# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags read by other libraries."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

from mcap.reader import make_reader
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from haptic_accel.bags.metadata import read_metadata

Row = tuple[str, int, bytes]
"""Topic, recording time in ns, and message."""


def with_rosbags(bag: Path) -> list[Row]:
    """Return a bag's messages as rosbags reads them."""
    with Reader(bag) as reader:
        rows = [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
        assert reader.message_count == len(rows)
    return rows


def deserialised(bag: Path, topics: Collection[str] = ()) -> dict[str, list[Any]]:
    """Return a bag's messages by topic, unpacked by rosbags; default: all topics.

    The definition of each type in the file must be self-contained.
    """
    types = get_typestore(Stores.ROS2_JAZZY)
    messages: dict[str, list[Any]] = {}
    with Reader(bag) as reader:
        wanted = [each for each in reader.connections if not topics or each.topic in topics]
        for connection in wanted:
            described = get_types_from_msg(connection.msgdef.data, connection.msgtype)
            assert connection.msgtype in described
            assert connection.digest.startswith("RIHS01_")
            messages[connection.topic] = []
        for connection, _, data in reader.messages(wanted) if wanted else ():
            messages[connection.topic].append(types.deserialize_cdr(data, connection.msgtype))
    return messages


def with_mcap(bag: Path) -> list[Row]:
    """Return a bag's messages, read file by file by the `mcap` library."""
    rows: list[Row] = []
    for entry in read_metadata(bag).files:
        with (bag / entry.name).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert reader.get_header().profile == "ros2"
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            assert summary.statistics.message_count == entry.messages
            found = reader.iter_messages()
            rows += [(channel.topic, each.log_time, each.data) for _, channel, each in found]
    return rows


def with_types(bag: Path) -> list[tuple[str, str, int, bytes]]:
    """Return topic, type, recording time in ns and bytes of a bag's messages."""
    with Reader(bag) as reader:
        return [(c.topic, c.msgtype, time, bytes(data)) for c, time, data in reader.messages()]
