# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Fewer points that keep what is seen."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptic_accel.analysis.traces import (
    Traces,
    enclosing,
    excerpt_of,
    most_active,
    sampled,
    thinned,
)


@settings(max_examples=40)
@given(st.integers(1, 5000), st.integers(1, 100), st.integers(0, 9))
def test_no_peak_is_lost(length: int, pairs: int, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=length)
    kept, step = thinned(values, 2 * pairs)
    assert len(kept) <= max(2 * pairs, 1)
    assert (kept.min(), kept.max()) == (values.min(), values.max())
    assert set(kept) <= set(values)
    assert step * len(kept) == pytest.approx(length)


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


@pytest.mark.filterwarnings("error")
def test_an_excerpt_of_another_trial_is_taken_where_the_signal_is_active() -> None:
    values = np.ones(1000)
    values[600:800] = 1.5
    values[100:300] = 0.1
    assert excerpt_of(values, 1000.0) == slice(600, 800)
    assert excerpt_of(values, 1000.0, 0.3) == slice(300, 500)
    assert excerpt_of(values, 1000.0, 0.1) == slice(600, 800)  # nearly silent there
    assert excerpt_of(values, 1000.0, 0.9) == slice(600, 800)  # beyond its end
    assert excerpt_of(values, 1000.0, 1.5) == slice(600, 800)  # of a longer trial


def test_the_error_over_a_whole_trial_is_that_of_the_samples() -> None:
    generator = np.random.default_rng(2)
    desired = generator.normal(size=50_000)
    traces = Traces.of({"desired": desired, "actual": 0.9 * desired}, 1000.0, 0.0)
    assert traces.whole.size < desired.size
    largest = np.abs(traces.whole.signals["error"]).max()
    assert largest == pytest.approx(0.1 * np.abs(desired).max())
