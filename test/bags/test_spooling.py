# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Bags whose signals lie on the disk."""

from __future__ import annotations

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
        (spool := Path(folder) / "spool").mkdir()
        assert_same(spooled_bags(path, spool, most=most)[0], read_bag(path))


def spooled(tmp_path: Path, stamps: list[int], *, most: int = 400) -> tuple[Bag, Bag]:
    """Return a bag with some stamps, from the disk and from memory."""
    rows = [message(TOOL_ACCELERATION, stamp, n) for n, stamp in enumerate(stamps)]
    custom = {f"{PREFIX}arguments": '{"rate": 1000.0}'}
    path = write_messages(tmp_path / "bag", rows, custom=custom)
    (tmp_path / "spool").mkdir()
    return spooled_bags(path, tmp_path / "spool", most=most)[0], read_bag(path)


def test_a_clock_that_was_set_back_between_two_parts_is_put_right(tmp_path: Path) -> None:
    stamps = [START + n * MS for n in range(1000)]
    found, whole = spooled(tmp_path, stamps[:500] + [each - 3000 * MS for each in stamps[500:]])
    assert "set back" in whole.problems[0]
    assert_same(found, whole)


def test_a_slow_drift_of_the_clock_is_found_that_no_part_shows(tmp_path: Path) -> None:
    # 0.1 % fast: each part of 400 samples drifts by 0.4 samples, the bag by 5.
    found, whole = spooled(tmp_path, [START + round(n * 1.001 * MS) for n in range(5000)])
    assert "another rate than its samples" in whole.problems[0]
    assert_same(found, whole)


def test_signals_are_read_from_the_disk(tmp_path: Path) -> None:
    found, _ = spooled(tmp_path, [START + n * MS for n in range(1000)])
    assert isinstance(found.signals[TOOL_ACCELERATION.name].values, np.memmap)


def test_progress_reaches_the_end(tmp_path: Path) -> None:
    rows = [message(TOOL_ACCELERATION, START + n * MS, n) for n in range(100)]
    path = write_messages(tmp_path / "bag", rows)
    shares: list[float] = []
    (tmp_path / "spool").mkdir()
    spooled_bags(path, tmp_path / "spool", shares.append, most=30)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert len(shares) > 1


@pytest.mark.parametrize("cut", [0.3, 0.9])
def test_a_bag_that_was_cut_off_is_read_as_far_as_it_is_intact(tmp_path: Path, cut: float) -> None:
    rows = [message(TOOL_ACCELERATION, START + n * MS, n) for n in range(9000)]
    path = write_messages(tmp_path / "bag", rows)
    (file,) = path.glob("*.mcap")
    data = file.read_bytes()
    file.write_bytes(data[: int(cut * len(data))])
    (tmp_path / "spool").mkdir()
    (found,), whole = spooled_bags(path, tmp_path / "spool", most=500), read_bag(path)
    assert whole.problems
    assert_same(found, whole)
