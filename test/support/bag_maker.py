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

"""Bags written by hand: what every topic carries, sample by sample."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core.cdr import StampedVector
from haptic_accel.core.topics import Topic

START = 1_255_392_000_000_000_000
"""13 October 2009, when the paper was presented; ns."""

NANOSECONDS = 1_000_000_000


def write_bag(
    bag: Path,
    rows: Mapping[Topic, np.ndarray],
    rate: float,
    *,
    lost: Collection[int] = (),
    lost_of: Mapping[Topic, Collection[int]] | None = None,
    delay: Callable[[int], int] = lambda place: 0,
    custom: Mapping[str, str] | None = None,
    compressed: bool = False,
) -> Path:
    """Write signals as an MCAP bag; return its folder.

    Parameters
    ----------
    rows : mapping
        Vectors of each topic, shape (n, 3).
    rate : float
        Of the samples, Hz; the first has the stamp `START`.
    lost, lost_of : collections
        Samples that are left out of all topics, and of one.
    delay : callable
        From a sample's stamp to when it was recorded, ns.
    custom : mapping
        Of the bag's own data.
    compressed : bool
        With zstd.
    """
    types: Any = get_typestore(Stores.ROS2_JAZZY)
    writer = Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP)
    if compressed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    for key, text in (custom or {}).items():
        writer.set_custom_data(key, text)
    with writer:
        connections = {
            topic: writer.add_connection(f"/{topic.name}", topic.type, typestore=types)
            for topic in rows
        }
        for place in range(max(len(vectors) for vectors in rows.values())):
            stamp = START + round(place * NANOSECONDS / rate)
            for topic, vectors in rows.items():
                if place in lost or place in (lost_of or {}).get(topic, ()):
                    continue
                message = StampedVector(topic).pack(stamp, tuple(vectors[place].tolist()))
                writer.write(connections[topic], stamp + delay(place), message)
    return bag
