from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from haptic_accel.core.topics import SIGNALS, VECTORS, Topic
from haptic_accel.nodes.interface import message_type
from haptic_accel.nodes.wire import StampedVector, reader

numbers = st.floats(allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
stamps = st.integers(0, 2**31 * 10**9 - 1)
frames = st.text(st.characters(codec="ascii", exclude_characters="\0"))
one_of_each_type = st.sampled_from(list({topic.type: topic for topic in SIGNALS}.values()))


def vector_of(message: Any, topic: Topic) -> tuple[float, float, float]:
    for name in VECTORS[topic.type].split("."):
        message = getattr(message, name)
    return (message.x, message.y, message.z)


@given(
    one_of_each_type,
    st.text(st.characters(codec="ascii", exclude_characters="\0")),
    stamps,
    vectors,
)
def test_ros_reads_what_is_packed(
    topic: Topic, frame: str, stamp: int, vector: tuple[float, float, float]
) -> None:
    message = message_type(topic)()
    message.header.frame_id = frame
    packed = StampedVector(message).pack(stamp, vector)
    read = deserialize_message(packed, message_type(topic))
    assert read.header.frame_id == frame
    assert read.header.stamp.sec * 10**9 + read.header.stamp.nanosec == stamp
    assert vector_of(read, topic) == vector


@given(
    one_of_each_type,
    st.text(st.characters(codec="ascii", exclude_characters="\0")),
    stamps,
    vectors,
)
def test_what_ros_writes_is_read(
    topic: Topic, frame: str, stamp: int, vector: tuple[float, float, float]
) -> None:
    message = message_type(topic)()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
    part: Any = message
    for name in VECTORS[topic.type].split("."):
        part = getattr(part, name)
    part.x, part.y, part.z = vector
    read = reader(message_type(topic), VECTORS[topic.type])
    assert read(serialize_message(message)) == (stamp, vector)


def test_big_endian_senders_are_read_too() -> None:
    topic = SIGNALS[0]
    # PoseStamped of stamp 1 s 2 ns, frame "a", position (1, 2, 3), big-endian CDR.
    import struct

    data = bytes([0, 0, 0, 0]) + struct.pack(">iII2s2x7d", 1, 2, 2, b"a\0", 1, 2, 3, 0, 0, 0, 1)
    read = reader(message_type(topic), VECTORS[topic.type])
    assert read(data) == (1_000_000_002, (1.0, 2.0, 3.0))


@pytest.mark.parametrize("topic", SIGNALS, ids=lambda topic: topic.name)
def test_every_signal_can_be_packed(topic: Topic) -> None:
    message = message_type(topic)()
    packed = StampedVector(message).pack(5, (1.0, 2.0, 3.0))
    assert vector_of(deserialize_message(packed, message_type(topic)), topic) == (1.0, 2.0, 3.0)
