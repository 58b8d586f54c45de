# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags whose signals lie on the disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bag_maker import Message, vector_bytes, write_messages
from haptic_accel.bags.reading import Bag, read_bag
from haptic_accel.bags.spooling import spooled_bags
from haptic_accel.bags.trial_metadata import PREFIX
from haptic_accel.core.topics import HANDLE_ACCELERATION, TOOL_ACCELERATION, Topic

START = 1_700_000_000_000_000_000
MS = 1_000_000


def message(topic: Topic, stamp: int, number: float) -> Message:
    data = vector_bytes(topic.type, stamp, topic.frame, (0.0, number, -number))
    return Message(f"/{topic.name}", topic.type, stamp + MS, data)


def assert_same(spooled: Bag, whole: Bag) -> None:
    assert spooled.signals.keys() == whole.signals.keys()
    for name, signal in whole.signals.items():
        assert np.array_equal(spooled.signals[name].stamps, signal.stamps)
        assert np.array_equal(spooled.signals[name].values, signal.values)
    assert spooled.counts == whole.counts
    assert spooled.metadata == whole.metadata
    assert spooled.problems == whole.problems


ticks = st.lists(st.integers(0, 60), min_size=1, max_size=60)
"""Ticks of samples in order of arrival: possibly twice, or out of order."""


@settings(max_examples=60)
@given(ticks, ticks, st.integers(1, 50), st.booleans())
def test_any_bag_has_the_content_that_it_has_in_memory(
    tool: list[int], handle: list[int], most: int, in_order: bool
) -> None:
    if in_order:
        tool, handle = sorted({*tool}), sorted({*handle})
    rows = [message(TOOL_ACCELERATION, START + n * MS, n) for n in tool]
    rows += [message(HANDLE_ACCELERATION, START + n * MS, n) for n in handle]
    with TemporaryDirectory() as folder:
        path = write_messages(Path(folder) / "bag", rows)
        assert_same(spooled(path, most=most), read_bag(path))


def spooled(path: Path, progress: Callable[[float], object] | None = None, *, most: int) -> Bag:
    (spool := path.parent / "spool").mkdir()
    return spooled_bags(path, spool, progress, most=most)[0]


def written(folder: Path, stamps: Iterable[int]) -> Path:
    """Write a bag of samples with some stamps."""
    rows = [message(TOOL_ACCELERATION, stamp, n) for n, stamp in enumerate(stamps)]
    custom = {f"{PREFIX}arguments": '{"rate": 1000.0}'}
    return write_messages(folder / "bag", rows, custom=custom)


def steady(count: int) -> list[int]:
    return [START + n * MS for n in range(count)]


@pytest.mark.parametrize(
    ("stamps", "told"),
    [
        # Between two parts.
        ([*steady(500), *(each + 500 * MS - 3000 * MS for each in steady(500))], "set back"),
        # 0.1 % fast: each part of 400 samples drifts by 0.4 samples, the bag by 5.
        ([START + round(n * 1.001 * MS) for n in range(5000)], "another rate than its samples"),
    ],
    ids=["set back", "drift"],
)
def test_what_is_wrong_with_a_clock_is_found_that_no_part_shows(
    tmp_path: Path, stamps: list[int], told: str
) -> None:
    path = written(tmp_path, stamps)
    found, whole = spooled(path, most=400), read_bag(path)
    assert told in whole.problems[0]
    assert_same(found, whole)


def test_signals_are_read_from_the_disk_and_progress_reaches_the_end(tmp_path: Path) -> None:
    shares: list[float] = []
    found = spooled(written(tmp_path, steady(100)), shares.append, most=30)
    assert isinstance(found.signals[TOOL_ACCELERATION.name].values, np.memmap)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) > 1


@pytest.mark.parametrize("cut", [0.3, 0.9])
def test_a_bag_that_was_cut_off_is_read_as_far_as_it_is_intact(tmp_path: Path, cut: float) -> None:
    path = written(tmp_path, steady(9000))
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: int(cut * len(data))])
    found, whole = spooled(path, most=500), read_bag(path)
    assert whole.problems
    assert_same(found, whole)
