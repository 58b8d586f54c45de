# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import replace
from itertools import chain
from operator import attrgetter
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core import cdr
from haptic_accel.core.model import IDENTITY, Vector
from haptic_accel.core.topics import BUNDLES, MASTER_POSITION, MASTER_WORK, SIGNALS, VECTORS, Topic

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


times = st.integers(0, 2**63 - 1)
names = st.text(st.characters(codec="utf-8", exclude_characters="\n"), max_size=30)
rows = st.tuples(names, times, stamps, st.tuples(*[st.floats(allow_nan=False)] * 7))
entries = st.lists(rows, min_size=1, max_size=20)

Entry = tuple[str, int, int, tuple[float, ...]]
"""Topic, system time of sending and stamp in ns, vector and orientation."""


def packed(given: list[Entry]) -> bytes:
    bundle = cdr.Bundle()
    for topic, time, stamp, values in given:
        bundle.put(time, bundle.index(topic), stamp, *values)
    return bundle.flush()


@given(entries)
def test_what_is_packed_comes_out_as_it_was_sent(given: list[Entry]) -> None:
    found = cdr.unpack_bundle(packed(given))
    assert [entry[:2] for entry in found] == [entry[:2] for entry in given]
    for (_, _, stamp, numbers), entry in zip(found, given, strict=True):
        assert stamp == struct.pack("<iI", *divmod(entry[2], 10**9))
        assert numbers == struct.pack("<7d", *entry[3])


def test_a_bundle_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="^too long$"):
        cdr.unpack_bundle(packed([("", 0, 0, (0.0,) * 7)] * (cdr.LONGEST_BUNDLE // 80)))


@given(entries)
def test_a_bundle_is_a_message_of_its_type(given: list[Entry]) -> None:
    data = packed(given)
    message = TYPES.deserialize_cdr(data, BUNDLES.type)
    assert isinstance(message.data, np.ndarray)
    assert bytes(TYPES.serialize_cdr(message, BUNDLES.type)) == data


@given(st.binary(max_size=200))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"^(too short|not|does not|ends)"):
        cdr.unpack_bundle(data)


@given(entries, st.data())
def test_what_is_cut_is_refused(given: list[Entry], data: st.DataObject) -> None:
    whole = packed(given)
    with pytest.raises(ValueError, match="too short|of another length"):
        cdr.unpack_bundle(whole[: data.draw(st.integers(0, len(whole) - 1))])


@given(entries, st.data())
def test_a_damaged_bundle_gives_nothing_longer_than_itself_or_is_refused(
    given: list[Entry], data: st.DataObject
) -> None:
    damaged = bytearray(packed(given))
    for place in data.draw(st.lists(st.integers(0, len(damaged) - 1), min_size=1, max_size=8)):
        damaged[place] = data.draw(st.integers(0, 255))
    with suppress(ValueError):
        found = cdr.unpack_bundle(bytes(damaged))
        assert 80 * len(found) < len(damaged)


def test_a_bundle_is_full_at_its_largest_size_and_empty_once_it_is_sent() -> None:
    bundle = cdr.Bundle()
    row = 0, bundle.index("/slave/measured_cp"), 0, *[0.0] * 7
    assert [bundle.put(*row) for _ in range(601)] == [False] * 600 + [True]
    assert cdr.LARGEST_BUNDLE < len(bundle.flush()) < cdr.LONGEST_BUNDLE
    assert bundle.flush() == b""


@given(st.lists(times, max_size=10).map(sorted), times)
def test_times_are_believed_within_a_second_before_reception_and_stay_in_order(
    sent: list[int], received: int
) -> None:
    found = [cdr.believed(time, received) for time in sent]
    assert found == sorted(found)
    assert all(received - 10**9 <= time <= received for time in found)
    for time, result in zip(sent, found, strict=True):
        assert result == time or not received - 10**9 <= time <= received


@given(
    st.lists(st.tuples(st.sampled_from("abc"), st.booleans()), max_size=30).flatmap(
        lambda sent: st.tuples(st.just(sent), st.randoms(use_true_random=False))
    )
)
def test_what_comes_both_ways_counts_once_in_whatever_order(drawn: Any) -> None:
    sent, random = drawn  # messages of bundles, and whether each was published by itself, too
    ways = [(text, True) for text, _ in sent]
    ways += [(text, False) for text, is_direct in sent if is_direct]
    random.shuffle(ways)
    both_ways = cdr.BothWays()
    kept = [
        text
        for text, bundled in ways
        if not both_ways.repeats(text.encode(), bundled=bundled, now=0.0)
    ]
    assert sorted(kept) == sorted(text for text, _ in sent)


def test_a_second_sender_of_the_same_counts_too_and_nothing_is_remembered_for_ever() -> None:
    both_ways = cdr.BothWays()
    direct = [both_ways.repeats(b"same", bundled=False, now=0.0) for _ in range(2)]
    assert [*direct, both_ways.repeats(b"same", bundled=True, now=0.1)] == [False, False, True]
    for later in (cdr.DUPLICATE_MEMORY, 2 * cdr.DUPLICATE_MEMORY):
        both_ways.repeats(b"other", bundled=False, now=later)
    assert not both_ways.repeats(b"same", bundled=True, now=2 * cdr.DUPLICATE_MEMORY)


@given(st.lists(st.lists(st.integers(0, 50)), max_size=10), st.integers(1, 4))
def test_no_item_is_lost_and_each_waits_for_so_many_rounds_at_most(
    rounds: list[list[int]], number: int
) -> None:
    in_order: cdr.InOrder[None] = cdr.InOrder(number)
    put: list[int] = []
    done: list[int] = []
    for index, added in enumerate(rounds):
        put += added
        done += [time for time, _ in in_order.round([(time, None) for time in added])]
        waited = list(chain(*rounds[: max(0, index + 1 - number)]))
        assert all(done.count(time) >= waited.count(time) for time in waited)
    done += [time for time, _ in in_order.rest()]
    assert sorted(done) == sorted(put)


@given(st.permutations(range(9)))
def test_what_is_late_by_less_than_the_rounds_is_put_in_order(shuffled: list[int]) -> None:
    in_order: cdr.InOrder[int] = cdr.InOrder(3)
    done: list[tuple[int, int]] = []
    for index in range(12):
        # Items of up to two rounds before come in this one.
        late = [i for i in shuffled if i + i % 3 == index]
        done += in_order.round([(i, i) for i in late])
    assert [item for _, item in (*done, *in_order.rest())] == list(range(9))
