from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core.parameters import ParameterError
from haptic_accel.nodes import topics
from haptic_accel.nodes.recorder import BagWriter

TYPES = get_typestore(Stores.ROS2_JAZZY)


def serialised(value: float, stamp: int = 0) -> bytes:
    message = TYPES.types["geometry_msgs/msg/AccelStamped"]
    header = TYPES.types["std_msgs/msg/Header"]
    time = TYPES.types["builtin_interfaces/msg/Time"]
    accel = TYPES.types["geometry_msgs/msg/Accel"]
    vector = TYPES.types["geometry_msgs/msg/Vector3"]
    made = message(
        header(time(0, stamp), "slave_tool"),
        accel(vector(0.0, 0.0, value), vector(0.0, 0.0, 0.0)),
    )
    return bytes(TYPES.serialize_cdr(made, "geometry_msgs/msg/AccelStamped"))


def test_what_is_put_in_is_read_back_in_order(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", 10_000)
    put = bag.connect(topics.TOOL_ACCELERATION, "/slave/tool/acceleration")
    values = np.random.default_rng(1).normal(size=1000).tolist()
    for value in values:
        put(serialised(value))
    bag.close()
    assert (bag.written, bag.dropped) == (1000, 0)
    with Reader(tmp_path / "bag") as reader:
        (connection,) = reader.connections
        assert connection.topic == "/slave/tool/acceleration"
        read = [
            TYPES.deserialize_cdr(data, connection.msgtype).accel.linear.z  # type: ignore[attr-defined]
            for _, _, data in reader.messages()
        ]
        assert reader.message_count == 1000
    assert read == values


def test_a_queue_that_is_full_drops_and_counts(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", 1)
    put = bag.connect(topics.TOOL_ACCELERATION, "/slave/tool/acceleration")
    message = serialised(1.0)
    for _ in range(20_000):
        put(message)
    bag.close()
    assert bag.dropped > 0
    assert bag.written + bag.dropped == 20_000
    with Reader(tmp_path / "bag") as reader:
        assert reader.message_count == bag.written


def test_a_topic_without_messages_is_in_the_bag_too(tmp_path: Path) -> None:
    bag = BagWriter(tmp_path / "bag", 10)
    bag.connect(topics.DIAGNOSTICS, "/diagnostics")
    bag.close()
    with Reader(tmp_path / "bag") as reader:
        assert [connection.topic for connection in reader.connections] == ["/diagnostics"]


def test_a_folder_that_is_there_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ParameterError, match="bag = "):
        BagWriter(tmp_path, 10)


def test_a_folder_that_cannot_be_made_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ParameterError, match="bag = "):
        BagWriter(tmp_path / "file" / "bag", 10)
