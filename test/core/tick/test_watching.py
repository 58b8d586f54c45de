# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0

"""Durations and traces of samples."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.tick import Trace
from haptic_accel.core.tick.watching import LONGEST_DURATION, SHORTEST, DurationHistogram

counted_apart = st.floats(SHORTEST, LONGEST_DURATION)


def filled(durations: list[float]) -> DurationHistogram:
    histogram = DurationHistogram()
    for duration in durations:
        histogram.add(duration)
    return histogram


@given(st.lists(counted_apart, min_size=1, max_size=300), st.floats(0.0, 1.0))
def test_quantile_is_within_one_percent(durations: list[float], q: float) -> None:
    exact = np.quantile(durations, q, method="inverted_cdf")
    assert filled(durations).quantile(q) == pytest.approx(exact, rel=0.01)


@given(st.lists(st.floats(allow_nan=False), min_size=1))
def test_count_and_maximum_are_exact_for_any_numbers(durations: list[float]) -> None:
    histogram = filled(durations)
    assert histogram.count == len(durations)
    assert histogram.maximum == max(durations)
    assert histogram.quantile(1.0) == max(durations)


def test_the_shortest_are_kept_together() -> None:
    histogram = filled([-1.0, 0.0, 1.0e-9, 0.5])
    assert histogram.count == 4
    assert histogram.quantile(0.75) == SHORTEST
    assert histogram.quantile(0.76) == 0.5


def test_the_longest_are_kept_together() -> None:
    histogram = filled([0.5, 1.0e3, 1.0e4])
    assert histogram.count == 3
    assert histogram.quantile(0.6) >= LONGEST_DURATION
    assert histogram.maximum == 1.0e4
    assert filled([math.inf]).maximum == math.inf
    apart = filled([LONGEST_DURATION, 1.0e3])
    assert apart.quantile(0.5) == pytest.approx(LONGEST_DURATION, rel=0.01)


def test_empty_has_no_quantile_and_no_maximum() -> None:
    histogram = DurationHistogram()
    assert (histogram.count, histogram.diagnostics("age")) == (0, {})
    assert math.isnan(histogram.maximum)
    assert math.isnan(histogram.quantile(0.5))


def test_reset_forgets_everything() -> None:
    histogram = filled([1.0, 2.0])
    histogram.reset()
    assert histogram.count == 0
    assert math.isnan(histogram.maximum)
    histogram.add(1.0e-3)
    assert histogram.quantile(0.5) == pytest.approx(1.0e-3, rel=0.01)


def test_nan_is_refused_and_not_counted() -> None:
    histogram = filled([1.0])
    with pytest.raises(ValueError, match="seconds = nan"):
        histogram.add(math.nan)
    assert histogram.count == 1
    assert histogram.maximum == 1.0


@pytest.mark.parametrize("q", [-0.1, 1.1, math.nan])
def test_quantile_out_of_range_is_refused(q: float) -> None:
    with pytest.raises(ValueError, match=r"^q = "):
        filled([1.0]).quantile(q)


def test_the_summary_has_every_reported_quantile_and_the_maximum() -> None:
    histogram = DurationHistogram()
    for microseconds in range(1, 1001):
        histogram.add(microseconds * 1e-6)
    summary = histogram.summary()
    assert list(summary) == ["p50", "p90", "p99", "p99_9", "max"]
    assert summary["p50"] == pytest.approx(500e-6, rel=0.01)
    assert summary["p99_9"] == pytest.approx(999e-6, rel=0.01)
    assert summary["max"] == 1000 * 1e-6
    told = histogram.diagnostics("age")
    assert list(told) == [f"age {label} (us)" for label in summary]
    assert told["age max (us)"] == "1000.0"


measurements = st.lists(st.sampled_from([0.5, 2.0, math.nan, math.inf]), max_size=50)


@given(measurements, st.integers(1, 10))
def test_a_trace_has_the_latest_samples_and_their_gaps(measured: list[float], kept: int) -> None:
    trace, latest, pushed = Trace(), 0.0, []
    trace.kept = kept
    for number, each in enumerate(measured):
        trace.push(1.0 * number, each, 2.0 * number, 3.0 * number)
        latest = each if math.isfinite(each) else latest
        pushed.append((1.0 * number, latest, 2.0 * number, 3.0 * number))
        assert min(kept, number + 1) <= trace.stored <= 2 * kept
        signals = [each[: trace.stored].tolist() for each in trace.signals]
        assert list(zip(*signals, strict=True)) == pushed[-trace.stored :]
        recent = range(max(0, number - kept + 1), number + 1)
        for gaps, is_gap in ((trace.missing, math.isnan), (trace.saturated, math.isinf)):
            expected = [each for each in recent if is_gap(measured[each])]
            assert [each for each in gaps if each in recent] == expected
            assert len(gaps) <= 2 * kept
    assert trace.count == len(measured)
    trace.reset()
    assert (trace.count, trace.stored, trace.missing, trace.saturated) == (0, 0, [], [])
    trace.push(0.0, math.nan, 0.0, 0.0)
    assert trace.measured[0] == 0.0, "nothing was measured since"
