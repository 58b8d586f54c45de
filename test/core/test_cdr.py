# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import struct
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core import cdr
from haptic_accel.core.model import IDENTITY, Vector
from haptic_accel.core.topics import MASTER_POSITION, MASTER_WORK, SIGNALS, VECTORS, Topic

TYPES: Any = get_typestore(Stores.ROS2_JAZZY)
"""Another program's CDR to compare with."""

numbers = st.floats(allow_nan=False)
vectors = st.tuples(numbers, numbers, numbers)
stamps = st.integers(0, 2**31 * 10**9 - 1)
frames = st.text(st.characters(codec="ascii", exclude_characters="\0"))
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]))
one_of_each_type = st.sampled_from(
    list({topic.type: topic for topic in (*SIGNALS, MASTER_WORK)}.values())
)
topics = st.builds(replace, one_of_each_type, frame=frames)

# PoseStamped of stamp 1 s 2 ns, frame "a", position (1, 2, 3), big-endian CDR.
BIG_ENDIAN = bytes(4) + struct.pack(">iII2s2x7d", 1, 2, 2, b"a\0", 1, 2, 3, 0, 0, 0, 1)


def arrays(messages: list[bytes]) -> tuple[list[int], list[list[float]], list[bool]]:
    """Unpack messages that lie one behind another, with a byte between."""
    ends = np.cumsum([len(message) + 1 for message in messages]) - 1
    starts = ends - [len(message) for message in messages]
    block = np.frombuffer(b"!".join(messages), np.uint8)
    found, values, formed = cdr.unpack_stamped_vectors(
        block, starts.astype(np.int64), ends.astype(np.int64)
    )
    return found.tolist(), values.tolist(), formed.tolist()


@given(stamps, st.tuples(texts, texts, texts), st.dictionaries(texts, texts))
def test_diagnostics_are_the_message_in_the_other_programs_bytes(
    stamp: int, texts: tuple[str, str, str], values: dict[str, str]
) -> None:
    packed = cdr.pack_diagnostics(stamp, 1, *texts, values)
    read = TYPES.deserialize_cdr(packed, "diagnostic_msgs/msg/DiagnosticArray")
    sec, nanosec = divmod(stamp, 10**9)
    assert (read.header.stamp.sec, read.header.stamp.nanosec) == (sec, nanosec)
    (status,) = read.status
    assert (status.level, status.name, status.message, status.hardware_id) == (1, *texts)
    assert [(pair.key, pair.value) for pair in status.values] == list(values.items())
    again = TYPES.serialize_cdr(read, "diagnostic_msgs/msg/DiagnosticArray")
    assert bytes(again) == packed


@given(topics, stamps, vectors)
def test_what_is_packed_is_the_message_in_the_other_programs_bytes(
    topic: Topic, stamp: int, vector: Vector
) -> None:
    packed = cdr.StampedVector(topic).pack(stamp, vector)
    message = TYPES.deserialize_cdr(packed, topic.type)
    assert message.header.frame_id == topic.frame
    assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    part = attrgetter(VECTORS[topic.type])(message)
    assert (part.x, part.y, part.z) == vector
    if hasattr(message, "pose"):
        rotation = message.pose.orientation
        assert (rotation.x, rotation.y, rotation.z, rotation.w) == (0, 0, 0, 1)
    assert bytes(TYPES.serialize_cdr(message, topic.type)) == packed
    numbers = struct.pack("<7d", *vector, *IDENTITY)
    assert cdr.StampedVector(topic).join(packed[cdr.STAMP_BYTES], numbers) == packed


@given(st.lists(st.tuples(topics, stamps, vectors), min_size=1, max_size=5))
def test_what_is_packed_is_unpacked_one_by_one_and_at_once(
    samples: list[tuple[Topic, int, Vector]],
) -> None:
    packed = [cdr.StampedVector(topic).pack(stamp, vector) for topic, stamp, vector in samples]
    assert [cdr.unpack_stamped_vector(data) for data in packed] == [each[1:] for each in samples]
    found, values, formed = arrays(packed)
    assert all(formed)
    assert found == [stamp for _, stamp, _ in samples]
    assert values == [list(vector) for _, _, vector in samples]
    assert cdr.unpack_stamps(b"".join(data[cdr.STAMP_BYTES] for data in packed)).tolist() == found


def test_big_endian_senders_are_read_too() -> None:
    assert cdr.unpack_stamped_vector(BIG_ENDIAN) == (1_000_000_002, (1.0, 2.0, 3.0))
    little = cdr.StampedVector(SIGNALS[0]).pack(7, (4.0, 5.0, 6.0))
    found, values, formed = arrays([BIG_ENDIAN, little])
    assert formed == [True, True]
    assert found == [1_000_000_002, 7]
    assert values == [[1, 2, 3], [4, 5, 6]]


def test_a_pose_has_an_orientation() -> None:
    assert cdr.unpack_orientation(BIG_ENDIAN) == (0.0, 0.0, 0.0, 1.0)
    pose = cdr.StampedVector(MASTER_POSITION)
    half_turn = (1.0, 0.0, 0.0, 0.0)
    assert cdr.unpack_orientation(pose.pack(5, (1.0, 2.0, 3.0))) == IDENTITY
    turned = pose.pack(6, (1.0, 2.0, 3.0), half_turn)
    assert cdr.unpack_orientation(turned) == half_turn
    assert cdr.unpack_stamped_vector(turned) == (6, (1.0, 2.0, 3.0))
    numbers = struct.pack("<7d", 1.0, 2.0, 3.0, *half_turn)
    assert pose.join(turned[cdr.STAMP_BYTES], numbers) == turned
    assert cdr.unpack_orientation(pose.pack(7, (1.0, 2.0, 3.0))) == IDENTITY
    with pytest.raises(ValueError, match="too short"):
        cdr.unpack_orientation(turned[:-1])


def test_no_messages_give_empty_arrays() -> None:
    nothing = np.empty(0, dtype=np.int64)
    found, values, formed = cdr.unpack_stamped_vectors(np.empty(0, np.uint8), nothing, nothing)
    assert (found.shape, values.shape, formed.shape) == ((0,), (0, 3), (0,))


def malformed(data: bytes) -> str:
    """Return the reason for which a message is refused; empty if it is unpacked."""
    try:
        cdr.unpack_stamped_vector(data)
    except ValueError as error:
        return str(error)
    return ""


LONG_NAME = bytes([0, 1, 0, 0]) + bytes(8) + struct.pack("<I", 2**32 - 1) + bytes(100)


@pytest.mark.parametrize(
    ("cut", "reason"),
    [
        *((BIG_ENDIAN[:length], "too short") for length in (0, 1, 2, 4, 8, 15, 16, 40, 43)),
        (LONG_NAME, "too short"),
        (bytes([0, 7, 0, 0]) + BIG_ENDIAN[4:], "not plain CDR"),
    ],
)
def test_a_malformed_message_is_refused_and_the_others_are_read(cut: bytes, reason: str) -> None:
    assert malformed(cut) == reason
    assert malformed(BIG_ENDIAN[:44]) == ""
    found, values, formed = arrays([BIG_ENDIAN, cut, BIG_ENDIAN])
    assert (found, values) == ([1_000_000_002] * 2, [[1, 2, 3]] * 2)
    assert formed == [True, False, True]


@given(
    st.binary(max_size=120)
    | st.binary(max_size=100).map(lambda tail: bytes([0, 1, 0, 0]) + tail)
    | st.binary(max_size=90).map(lambda tail: BIG_ENDIAN[:12] + bytes(3) + tail)
)
def test_any_bytes_are_unpacked_or_refused_alike_one_by_one_and_at_once(data: bytes) -> None:
    found, values, formed = arrays([BIG_ENDIAN, data])
    assert formed == [True, not malformed(data)]
    if not malformed(data):
        stamp, vector = cdr.unpack_stamped_vector(data)
        assert found[1] == stamp
        assert np.array_equal(values[1], vector, equal_nan=True)


def serialised(kind: str, data: bool | str) -> list[bytes]:
    """Return the other program's bytes of a message, for either order of bytes."""
    message = TYPES.types[kind](data=data)
    orders = (True, False)
    return [bytes(TYPES.serialize_cdr(message, kind, little_endian=each)) for each in orders]


@pytest.mark.parametrize("state", [True, False])
def test_a_state_of_the_other_program_is_unpacked(state: bool) -> None:
    for data in serialised("std_msgs/msg/Bool", state):
        assert cdr.unpack_state(data) is state


@given(st.binary(max_size=8))
def test_any_bytes_are_a_state_or_refused(data: bytes) -> None:
    if len(data) > 4 and data[1] in (0, 1):
        assert cdr.unpack_state(data) == (data[4] != 0)
    else:
        with pytest.raises(ValueError, match=r"^(too short|not plain CDR)$"):
            cdr.unpack_state(data)


@given(texts.filter(lambda text: len(text) <= 20))
def test_a_text_of_the_other_program_is_unpacked(text: str) -> None:
    for data in serialised("std_msgs/msg/String", text):
        assert cdr.unpack_text(data, 4) == text
        for cut in range(len(data)):
            with pytest.raises(ValueError, match=r"^(too short|not plain CDR)$"):
                cdr.unpack_text(data[:cut], 4)
