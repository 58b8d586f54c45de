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

"""Bags as the readers of others see them."""

from __future__ import annotations

from pathlib import Path

from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from haptic_accel.bags.metadata import read_metadata

Row = tuple[str, int, bytes]
"""Topic, when it was recorded in ns, and the message."""


def with_rosbags(bag: Path) -> list[Row]:
    """Return a bag's messages as rosbags reads them."""
    with Reader(bag) as reader:
        rows = [(c.topic, time, bytes(data)) for c, time, data in reader.messages()]
        assert reader.message_count == len(rows)
    return rows


def with_mcap(bag: Path) -> list[Row]:
    """Return a bag's messages as mcap's own reader reads its files one by one."""
    rows: list[Row] = []
    for entry in read_metadata(bag).files:
        with (bag / entry.name).open("rb") as stream:
            reader = make_reader(stream, validate_crcs=True)
            assert reader.get_header().profile == "ros2"
            summary = reader.get_summary()
            assert summary is not None
            assert summary.statistics is not None
            assert summary.statistics.message_count == entry.messages
            rows += [
                (channel.topic, message.log_time, message.data)
                for _, channel, message in reader.iter_messages()
            ]
    return rows
