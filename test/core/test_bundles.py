# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

from __future__ import annotations

import struct
from contextlib import suppress
from itertools import chain
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from haptic_accel.core import bundles
from haptic_accel.core.topics import BUNDLES

TYPES: Any = get_typestore(Stores.ROS2_JAZZY)
"""Another program's CDR to compare with."""

times = st.integers(0, 2**63 - 1)
names = st.text(st.characters(codec="utf-8", exclude_characters="\n"), max_size=30)
stamps = st.integers(0, 2**31 * 10**9 - 1)
rows = st.tuples(names, times, stamps, st.tuples(*[st.floats(allow_nan=False)] * 7))
entries = st.lists(rows, min_size=1, max_size=20)

Entry = tuple[str, int, int, tuple[float, ...]]
"""Topic, system time of sending and stamp in ns, vector and orientation."""


def packed(given: list[Entry]) -> bytes:
    bundle = bundles.Bundle()
    for topic, time, stamp, values in given:
        bundle.put(time, bundle.index(topic), stamp, *values)
    return bundle.flush()


@given(entries)
def test_what_is_packed_comes_out_as_it_was_sent(given: list[Entry]) -> None:
    found = bundles.unpack_bundle(packed(given))
    assert [entry[:2] for entry in found] == [entry[:2] for entry in given]
    for (_, _, stamp, numbers), entry in zip(found, given, strict=True):
        assert stamp == struct.pack("<iI", *divmod(entry[2], 10**9))
        assert numbers == struct.pack("<7d", *entry[3])


def test_a_bundle_that_is_too_long_is_refused() -> None:
    with pytest.raises(ValueError, match="^too long$"):
        bundles.unpack_bundle(packed([("", 0, 0, (0.0,) * 7)] * (bundles.LONGEST_BUNDLE // 80)))


@given(entries)
def test_a_bundle_is_a_message_of_its_type(given: list[Entry]) -> None:
    data = packed(given)
    message = TYPES.deserialize_cdr(data, BUNDLES.type)
    assert isinstance(message.data, np.ndarray)
    assert bytes(TYPES.serialize_cdr(message, BUNDLES.type)) == data


@given(st.binary(max_size=200))
def test_garbage_is_refused(data: bytes) -> None:
    with pytest.raises(ValueError, match=r"^(too short|not|does not|ends)"):
        bundles.unpack_bundle(data)


@given(entries, st.data())
def test_what_is_cut_is_refused(given: list[Entry], data: st.DataObject) -> None:
    whole = packed(given)
    with pytest.raises(ValueError, match="too short|of another length"):
        bundles.unpack_bundle(whole[: data.draw(st.integers(0, len(whole) - 1))])


@given(entries, st.data())
def test_a_damaged_bundle_gives_nothing_longer_than_itself_or_is_refused(
    given: list[Entry], data: st.DataObject
) -> None:
    damaged = bytearray(packed(given))
    for place in data.draw(st.lists(st.integers(0, len(damaged) - 1), min_size=1, max_size=8)):
        damaged[place] = data.draw(st.integers(0, 255))
    with suppress(ValueError):
        found = bundles.unpack_bundle(bytes(damaged))
        assert 80 * len(found) < len(damaged)


def test_a_bundle_is_full_at_its_largest_size_and_empty_once_it_is_sent() -> None:
    bundle = bundles.Bundle()
    row = 0, bundle.index("/slave/measured_cp"), 0, *[0.0] * 7
    assert [bundle.put(*row) for _ in range(601)] == [False] * 600 + [True]
    assert bundles.LARGEST_BUNDLE < len(bundle.flush()) < bundles.LONGEST_BUNDLE
    assert bundle.flush() == b""


@given(st.lists(times, max_size=10).map(sorted), times)
def test_times_are_believed_within_a_second_before_reception_and_stay_in_order(
    sent: list[int], received: int
) -> None:
    found = [bundles.believed(time, received) for time in sent]
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
    both_ways = bundles.BothWays()
    kept = [
        text
        for text, bundled in ways
        if not both_ways.repeats(text.encode(), bundled=bundled, now=0.0)
    ]
    assert sorted(kept) == sorted(text for text, _ in sent)


def test_a_second_sender_of_the_same_counts_too_and_nothing_is_remembered_for_ever() -> None:
    both_ways = bundles.BothWays()
    direct = [both_ways.repeats(b"same", bundled=False, now=0.0) for _ in range(2)]
    assert [*direct, both_ways.repeats(b"same", bundled=True, now=0.1)] == [False, False, True]
    for later in (bundles.DUPLICATE_MEMORY, 2 * bundles.DUPLICATE_MEMORY):
        both_ways.repeats(b"other", bundled=False, now=later)
    assert not both_ways.repeats(b"same", bundled=True, now=2 * bundles.DUPLICATE_MEMORY)


@given(st.lists(st.lists(st.integers(0, 50)), max_size=10), st.integers(1, 4))
def test_no_item_is_lost_and_each_waits_for_so_many_rounds_at_most(
    rounds: list[list[int]], number: int
) -> None:
    in_order: bundles.InOrder[None] = bundles.InOrder(number)
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
    in_order: bundles.InOrder[int] = bundles.InOrder(3)
    done: list[tuple[int, int]] = []
    for index in range(12):
        # Items of up to two rounds before come in this one.
        late = [i for i in shuffled if i + i % 3 == index]
        done += in_order.round([(i, i) for i in late])
    assert [item for _, item in (*done, *in_order.rest())] == list(range(9))
