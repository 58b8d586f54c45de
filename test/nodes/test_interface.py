from __future__ import annotations

import signal
import struct
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message

from haptic_accel.bags.reading import read_bag
from haptic_accel.core.cdr import StampedVector, unpack_stamped_vector
from haptic_accel.core.model import Vector
from haptic_accel.core.topics import (
    ACTUATOR_FORCE,
    EMERGENCY_STOP,
    MASTER_STOPPED,
    SIGNALS,
    SLAVE_STOPPED,
    VECTORS,
    Topic,
)
from haptic_accel.nodes.interface import message_type, quality
from observing import Observer
from running import Command, wait_until

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


LITTLE_ENDIAN, ANOTHER = bytes([0, 1, 0, 0]), bytes([0, 7, 0, 0])

GARBAGE = (
    b"",
    b"\0",
    LITTLE_ENDIAN,
    LITTLE_ENDIAN + bytes(8) + struct.pack("<I", 2**32 - 1) + bytes(100),  # a frame of 4 GB
    ANOTHER + bytes(124),
    bytes(4) + struct.pack("<iII4s7d", 1, 0, 4, b"arm", *[1.0] * 7),  # in the other byte order
)

STATES = (EMERGENCY_STOP, MASTER_STOPPED, SLAVE_STOPPED)


def test_messages_that_are_malformed_are_refused_and_counted_and_the_graph_goes_on(
    haptic_accel: Callable[..., Command], observer: Observer, tmp_path: Path
) -> None:
    graph = haptic_accel("teleop", "bag:=bag")
    graph.wait_for("engaged")
    sent = {
        observer.node.create_publisher(message_type(topic), topic.name, quality(topic)): pieces
        for topics, pieces in ((SIGNALS, GARBAGE), (STATES, GARBAGE[:3]))
        for topic in topics
    }

    def all_refused(node: str) -> bool:
        for publisher, pieces in sent.items():
            for data in pieces:
                publisher.handle.publish_raw(data)
        return int(observer.status(node)["messages malformed"]) >= len(GARBAGE)

    for node in ("master_device", "slave_device", "compensator", "coupler", "recorder"):
        wait_until(partial(all_refused, node), f"counted by {node}")
    observer.collect((ACTUATOR_FORCE,), 100)
    assert graph.end(signal.SIGINT) == 0, graph.text
    assert read_bag(tmp_path / "bag").problems == []
