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

"""Samples of the fast path in shared memory: contiguous, and right."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import Vector
from haptic_accel.kits.lerobot.exchange import LONGEST, LOST, SLOTS, Ring, memory_file


@pytest.fixture
def descriptor() -> Iterator[int]:
    found = memory_file()
    yield found
    os.close(found)


def sample(tick: int) -> Vector:
    """Return an acceleration that tells its tick."""
    return float(tick), -float(tick), tick / 2


def test_nothing_is_read_before_there_are_as_many_samples(descriptor: int) -> None:
    ring = Ring(descriptor)
    assert ring.newest(1) is None
    ring.put(7, sample(7))
    assert ring.newest(2) is None
    found = ring.newest(1)
    assert found is not None
    assert (found[0], found[1].tolist()) == (7, [list(sample(7))])


@settings(max_examples=20)
@given(st.integers(0, 3 * SLOTS), st.integers(1, LONGEST))
def test_another_user_reads_the_newest_samples_in_their_order(count: int, size: int) -> None:
    descriptor = memory_file()
    try:
        writer, reader = Ring(descriptor), Ring(descriptor)
    finally:
        os.close(descriptor)
    for tick in range(count):
        writer.put(tick, sample(tick))
    found = reader.newest(size)
    if count < size:
        assert found is None
        return
    assert found is not None
    assert found[0] == count - 1
    np.testing.assert_array_equal(found[1][:, 0], np.arange(count - size, count))
    np.testing.assert_array_equal(found[1][:, 2], np.arange(count - size, count) / 2)


@pytest.mark.parametrize("gap", [1, 5, 2 * SLOTS])
def test_ticks_without_a_sample_hold_the_one_before_and_are_counted(
    descriptor: int, gap: int
) -> None:
    ring = Ring(descriptor)
    for tick in (10, 11, 12 + gap):
        ring.put(tick, sample(tick))
    found = ring.newest(min(gap, LONGEST - 1) + 1)
    assert found is not None
    tick, samples = found
    assert tick == 12 + gap
    assert set(samples[:-1, 0]) == {11.0}
    assert samples[-1, 0] == tick
    assert ring.counts[LOST] == min(gap, SLOTS)
