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

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.core.model import Vector
from haptic_accel.kits.lerobot.exchange import LONGEST, LOST, SLOTS, Ring, memory_file


def rings() -> tuple[Ring, Ring]:
    """Return the same samples twice, as the writer and a reader have them."""
    descriptor = memory_file()
    try:
        return Ring(descriptor), Ring(descriptor)
    finally:
        os.close(descriptor)


def sample(tick: int) -> Vector:
    """Return an acceleration that tells its tick."""
    return float(tick), -float(tick), tick / 2


@settings(max_examples=20)
@given(st.integers(0, 3 * SLOTS), st.integers(1, LONGEST))
def test_another_user_reads_the_newest_samples_in_their_order(count: int, size: int) -> None:
    writer, reader = rings()
    for tick in range(count):
        writer.put(tick, sample(tick))
    found = reader.newest(size)
    if count < size:
        assert found is None
        return
    assert found is not None
    assert found[0] == count - 1
    np.testing.assert_array_equal(found[1], [sample(tick) for tick in range(count - size, count)])


@pytest.mark.parametrize("gap", [1, 5, 2 * SLOTS])
def test_ticks_without_a_sample_hold_the_one_before_and_are_counted(gap: int) -> None:
    ring, _ = rings()
    for tick in (10, 11, 12 + gap):
        ring.put(tick, sample(tick))
    found = ring.newest(min(gap, LONGEST - 1) + 1)
    assert found is not None
    tick, samples = found
    assert tick == 12 + gap
    assert set(samples[:-1, 0]) == {11.0}
    assert samples[-1, 0] == tick
    assert ring.counts[LOST] == min(gap, SLOTS)
