"""Fewer points that keep what is seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.analysis.traces import enclosing, most_active, sampled, thinned


@settings(max_examples=40)
@given(st.integers(1, 5000), st.integers(1, 100), st.integers(0, 9))
def test_no_peak_is_lost(length: int, pairs: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=length)
    kept, step = thinned(values, 2 * pairs)
    assert len(kept) <= max(2 * pairs, 1)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert set(kept) <= set(values)
    assert step * len(kept) == pytest.approx(length)


def test_a_short_signal_stays() -> None:
    values = np.arange(10.0)
    kept, step = thinned(values, 10)
    assert kept is values
    assert step == 1.0


def test_the_liveliest_window_is_where_the_burst_is() -> None:
    values = np.zeros(1000)
    values[400:450] = 3.0
    assert most_active(values, 50) == slice(400, 450)
    assert most_active(values, 5000) == slice(0, 1000)


def test_some_points_are_different_ones() -> None:
    assert len(set(sampled(10_000, 300).tolist())) == 300
    np.testing.assert_array_equal(sampled(5, 300), np.arange(5))


@settings(max_examples=40)
@given(st.integers(0, 50), st.integers(1, 50), st.integers(0, 100), st.integers(0, 200))
def test_what_lies_around_holds_it(start: int, length: int, behind: int, samples: int) -> None:
    size = start + length + behind
    found = enclosing(slice(start, start + length), size, samples)
    assert 0 <= found.start <= start
    assert start + length <= found.stop <= size
    assert found.stop - found.start == min(max(samples, length), size)
