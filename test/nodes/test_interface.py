from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.model import Vector
from haptic_accel.core.topics import SIGNALS, VECTORS, Topic
from haptic_accel.nodes.interface import message_type

numbers = st.floats(allow_nan=False)
frames = st.text(st.characters(codec="ascii", exclude_characters="\0"))
one_of_each_type = st.sampled_from(list({topic.type: topic for topic in SIGNALS}.values()))


@given(
    st.builds(replace, one_of_each_type, frame=frames),
    st.integers(0, 2**31 * 10**9 - 1),
    st.tuples(numbers, numbers, numbers),
)
def test_ros_reads_what_is_packed_and_what_it_writes_is_unpacked(
    topic: Topic, stamp: int, vector: Vector
) -> None:
    packed = StampedVector(topic).pack(stamp, vector)
    message = deserialize_message(packed, message_type(topic))
    assert message.header.frame_id == topic.frame
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    outer, inner = VECTORS[topic.type].split(".")
    part = getattr(getattr(message, outer), inner)
    assert (part.x, part.y, part.z) == vector
    assert unpack_stamped_vector(serialize_message(message)) == (stamp, vector)
